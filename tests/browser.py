"""Chromium without a window, steered through its debugging pipe: real key presses, real layouts."""

import json
import os
import shutil
import subprocess
import time
from itertools import count
from pathlib import Path

from patience import patience

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")


def program() -> str | None:
    """The browser's path, where one is installed."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Browser:
    """`with Browser(profile, width, height) as page: page.open(path)`."""

    def __init__(self, profile: Path, width: int, height: int, webgl: bool = False) -> None:
        self.size, self.numbers, self.rest, self.session = (width, height), count(1), b"", None
        reads, theirs_out = os.pipe()
        theirs_in, writes = os.pipe()
        flags = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--remote-debugging-pipe",
            f"--user-data-dir={profile}",
        ]
        if webgl:  # computed by the processor
            flags.remove("--disable-gpu")
            flags += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

        def numbered():  # the browser listens on 3 and answers on 4
            spare_in, spare_out = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(spare_in, 3)
            os.dup2(spare_out, 4)

        about = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "close_fds": False}
        self.process = subprocess.Popen([program(), *flags], preexec_fn=numbered, **about)
        for end in (theirs_in, theirs_out):
            os.close(end)
        self.reads, self.writes = reads, writes

    def __enter__(self) -> "Browser":
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        width, height = self.size
        phone = width < 600
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=phone,
        )
        self.call("Page.enable")
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.reads)
        os.close(self.writes)

    def call(self, method: str, **parameters: object) -> dict:
        """The browser's answer."""
        number = next(self.numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.writes, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._message()
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    def _message(self) -> dict:
        while b"\0" not in self.rest:
            data = os.read(self.reads, 1 << 20)
            assert data, "the browser ended"
            self.rest += data
        message, _, self.rest = self.rest.partition(b"\0")
        return json.loads(message)

    def open(self, path: Path) -> None:
        """Until it is loaded."""
        self.call("Page.navigate", url=path.resolve().as_uri())
        while self._message().get("method") != "Page.loadEventFired":
            pass

    def value(self, expression: str):
        """Of JavaScript. Fails where it throws."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression: str, seconds: float = 20) -> None:
        """Wait until JavaScript's value is true."""
        ends = time.monotonic() + patience(seconds)
        while not self.value(expression):
            assert time.monotonic() < ends, expression
            time.sleep(0.05)

    def press(self, key: str) -> None:
        """Tab, Enter or a letter, as from a keyboard."""
        codes = {"Tab": 9, "Enter": 13, "ArrowLeft": 37, "ArrowRight": 39}
        text = {"text": "\r"} if key == "Enter" else {} if key in codes else {"text": key}
        about = {"key": key, "windowsVirtualKeyCode": codes.get(key, ord(key[0])), **text}
        self.call("Input.dispatchKeyEvent", type="keyDown", **about)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def picture(self, whole: bool = True) -> str:
        """PNG, base64."""
        return self.call("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
