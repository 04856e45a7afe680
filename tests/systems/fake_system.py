"""A stand-in for a SLAM system: writes what is true of the staged frames, spoilt as its first
argument says. MODE STAGE OUT TRUTH OFFSET.
"""

import json
import os
import signal
import subprocess
import sys
import time

mode, stage, out, truth, offset = sys.argv[1:6]
with open(os.path.join(out, "arguments.json"), "w") as file:
    json.dump(sys.argv[6:], file)
with open(os.path.join(stage, "associations.txt")) as file:
    stamps = [line.split()[0] for line in file]
with open(truth) as file:
    poses = [line.split()[1:] for line in file if line[0] != "#"]
rows = [(float(stamp), *map(float, pose)) for stamp, pose in zip(stamps, poses, strict=False)]

if mode == "hangs":
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    time.sleep(60)
elif mode == "stops at zero" and rows[0][0] <= 0:
    sys.exit(0)  # as RTAB-Map does
elif mode == "says why":
    print("cannot open display")
    sys.exit(0)
elif mode == "a third":
    rows = rows[: len(rows) // 3]
elif mode == "keyframes":
    rows = rows[::5]
elif mode == "a second late":
    rows = [(row[0] + 1, *row[1:]) for row in rows]
elif mode == "between frames":
    rows = [(row[0] + 0.0123, *row[1:]) for row in rows]
elif mode == "starts late":
    rows[:15] = [(row[0], row[1] + 1.0, *row[2:]) for row in rows[:15]]
elif mode == "some NaN":
    rows[10:13] = [(row[0], *[float("nan")] * 7) for row in rows[10:13]]
elif mode == "all NaN":
    rows = [(row[0], *[float("nan")] * 7) for row in rows]
elif mode == "twice":
    rows[20] = rows[19]
elif mode == "nanoseconds":
    rows = [(row[0] * 1e9, *row[1:]) for row in rows]
elif mode == "90 Hz":
    rows = [(row[0] + k / 90, *row[1:]) for row in rows for k in range(3)]
elif mode == "words":
    rows = [("pose",)]

if mode != "nothing":
    with open(os.path.join(out, "final.txt"), "w") as file:
        for row in rows:
            file.write(
                " ".join(f"{value:.6f}" if isinstance(value, float) else value for value in row)
                + "\n"
            )
    with open(
        os.path.join(out, "live.txt"), "w"
    ) as file:  # number and 3x4 matrix, in the first camera's place
        for number, row in enumerate(rows if mode != "words" else ()):
            matrix = f"1 0 0 {row[1]:.6f} 0 1 0 {row[2]:.6f} 0 0 1 {row[3]:.6f}"
            file.write(f"{number} {matrix}\n" if "nan" not in matrix else "")
if mode == "cut":  # killed while it wrote its 30th line
    with open(os.path.join(out, "final.txt"), "r+") as file:
        lines = file.readlines()
        file.truncate(sum(map(len, lines[:29])) + 20)
    os.kill(os.getpid(), signal.SIGKILL)
if mode == "crashes at the end":
    os.kill(os.getpid(), signal.SIGSEGV)
sys.exit(3 if mode == "exit 3" else 0)
