"""The level of each perturbation is what its unit says, by a formula that knows nothing of the code.

Every law is checked at one severity of perturbations.toml, with the fixed settings of the file, on
small images: a wall in front of a camera that stands still unless the law is about motion.
"""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.benchmark.experiments.outcome import RecordingOdometer
from iclnuim.benchmark.odometry.protocol import Frame
from iclnuim.benchmark.perturbations.filters import random_field
from iclnuim.benchmark.perturbations.motion import Shift
from iclnuim.benchmark.perturbations.plan import FUNCTIONS, read_plan
from iclnuim.benchmark.perturbations.segment import Segment
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sensor.transfer import linear_from_srgb8, srgb8

PLAN = read_plan()
FX = 120.0
CAMERA = PinholeCamera(160, 120, FX, 120.0, 79.5, 59.5)
U, V = np.meshgrid(np.arange(160), np.arange(120))
HZ = 30
AT = 15  # the number of the frame that is looked at


def still(grey=128, depth_m=2.0, frames=60, camera=CAMERA, twist_per_s=None):
    """Frames at 30 Hz of one image, seen by a camera that stands still or moves steadily."""
    shape = (camera.height, camera.width)
    colour = np.broadcast_to(np.uint8(grey), (*shape, 3)).copy()
    depth_z_m = np.broadcast_to(np.float32(depth_m), shape).copy()
    stamps_s = np.arange(frames) / HZ
    twists = stamps_s[:, None] * (np.zeros(6) if twist_per_s is None else twist_per_s)
    truth = Trajectory(stamps_s, SE3.exp(twists))
    stamps = dict(enumerate(stamps_s.tolist()))
    numbers = tuple(range(frames))
    return Segment(camera, camera, numbers, stamps, truth, lambda number: (colour, depth_z_m), 3)


def numbered(frames):
    """Frames of one pixel whose grey value is their number, modulo 250, plus one."""
    found = still(frames=frames, camera=PinholeCamera(2, 2, 2.0, 2.0, 0.5, 0.5))

    def load(number):
        return np.full((2, 2, 3), number % 250 + 1, np.uint8), np.ones((2, 2), np.float32)

    return replace(found, load=load)


def coordinates():
    """An image that is wide in colours: the red of a pixel is its column, the green its row."""
    return np.stack([U, V, np.zeros_like(U)], -1)


def perturbed(name, severity, segment, number=AT):
    """The level of the severity, and colour and depth of a perturbed frame."""
    level = PLAN.perturbations[name].levels[severity - 1]
    return (level, *PLAN.apply(name, severity, segment).load(number))


def in_middle(percent):
    """Whether a pixel is on the rectangle in the middle of the image with this share of it."""
    half = np.sqrt(percent / 100) / 2
    return (np.abs(U - 79.5) < 160 * half) & (np.abs(V - 59.5) < 120 * half)


def mirrored_at_the_image_plane():
    """The column and row of coordinates() in the direction in which a mirror parallel to the image
    shows the surroundings: the image spans all directions, mirrored left and right.
    """
    x, y = (U - 79.5) / FX, (V - 59.5) / 120.0
    azimuth, height = np.arctan2(x, -1), np.arctan2(y, np.hypot(x, 1))
    return np.abs(azimuth) / np.pi * 159, (height / np.pi + 0.5) * 119


LAWS = {}


def law(function):
    LAWS[function.__name__] = function
    return function


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_level_is_what_its_unit_says(name):
    LAWS[name]()


# -- images


@law
def flat_texture():
    image = np.random.default_rng(0).integers(0, 256, (120, 160, 3))
    level, colour, _ = perturbed("flat_texture", 1, still(image))
    assert colour.std() / image.std() == pytest.approx(1 - level / 100, rel=0.02)
    assert colour.mean() == pytest.approx(image.mean(), abs=0.5)


@law
def noise():
    """The released noise: colour; disparity, in steps of 1 / 35130 cm, with a deviation of 1/6 and
    a mean of 1/2 before it is rounded; places with a deviation of 1.15 px and a mean of -1/2.
    """
    _, once, _ = perturbed("noise", 2, still(128))
    assert PLAN.perturbations["noise"].levels[1] == 1
    for severity in (5, 4):
        level, colour, depth_z_m = perturbed("noise", severity, still(128))
        assert (colour - 128.0).std() / (once - 128.0).std() == pytest.approx(level, rel=0.05)
        disparity = 35130 / (100 * depth_z_m[20:-20, 20:-20])
        assert disparity.mean() == pytest.approx(35130 / 200 + level / 2, abs=0.1)
        assert disparity.var() == pytest.approx((level / 6) ** 2 + 1 / 12, rel=0.1)
    edge = still(depth_m=np.where(U < 80, 2.0, 2.05))
    depth_z_m = np.mean([perturbed("noise", 4, edge, number)[2] for number in range(20)], axis=0)
    slope = np.diff(depth_z_m[20:-20].mean(0))[60:100]
    slope /= slope.sum()
    centre = (slope * np.arange(60.5, 100)).sum()
    assert centre == pytest.approx(79.5 + level / 2, abs=0.3)
    width = np.sqrt((slope * (np.arange(60.5, 100) - centre) ** 2).sum())
    assert width == pytest.approx(level * 1.15, rel=0.1)


@law
def low_light():
    level, colour, depth_z_m = perturbed("low_light", 1, still(255))
    assert linear_from_srgb8(colour).mean() == pytest.approx(2.0**-level, rel=0.05)
    assert (depth_z_m == 2).all()


def stops(name, severity, number):
    level, colour, _ = perturbed(name, severity, still(100), number)
    return level, np.log2(linear_from_srgb8(colour).mean() / linear_from_srgb8(np.uint8([[[100]]])))


@law
def exposure_steps():
    """Every 5 frames."""
    for number, down in ((4, 0), (5, 1), (9, 1), (10, 0), (15, 1)):
        level, found = stops("exposure_steps", 2, number)
        assert found == pytest.approx(-level * down, abs=0.03)


@law
def exposure_hunting():
    """Twice a second."""
    for number in (0, 2, 4, 11, 19):
        level, found = stops("exposure_hunting", 2, number)
        expected = level * np.sin(2 * np.pi * 2 * number / HZ)
        assert found == pytest.approx(expected, abs=0.04)


@law
def gamma_steps():
    """Every 5 frames."""
    for number, raised in ((4, False), (5, True), (9, True), (10, False)):
        level, colour, _ = perturbed("gamma_steps", 4, still(U[..., None]), number)
        expected = 255 * (U / 255) ** (level if raised else 1)
        assert np.abs(colour[..., 0] - expected).max() <= 0.5


def response(name, severity):
    """The level, and the profile of a white line, of which each value was rounded down."""
    level, colour, _ = perturbed(name, severity, still(255 * (U[..., None] == 80)))
    profile = colour[60, :, 0].astype(float)
    return level, np.where(profile > 0, profile + 0.5, 0)


def deviation_px(profile):
    return np.sqrt((profile * (np.arange(160) - 80) ** 2).sum() / profile.sum())


@law
def gaussian_blur():
    level, profile = response("gaussian_blur", 3)
    assert profile.max() / 255 == pytest.approx(1 / (level * np.sqrt(2 * np.pi)), rel=0.03)


@law
def defocus_blur():
    """A disc has a deviation of half its radius along a line; its edge is smoothed by 0.5 px."""
    level, profile = response("defocus_blur", 1)
    u, v = np.meshgrid(np.arange(-8, 9), np.arange(-8, 9))
    disc = u[u**2 + v**2 <= level**2]
    smooth = np.exp(-((np.array([-1, 0, 1]) / 0.5) ** 2) / 2)
    variance = disc.var() + 2 * smooth[0] / smooth.sum()
    assert deviation_px(profile) == pytest.approx(np.sqrt(variance), rel=0.02)
    level, profile = response("defocus_blur", 3)
    assert deviation_px(profile) == pytest.approx(level / 2, rel=0.05)
    assert np.flatnonzero(profile).tolist() == list(range(80 - int(level), 81 + int(level)))


@law
def jpeg_compression():
    """libjpeg multiplies its table, which begins with 16, by 5000 / quality percent; the mean of a
    block of 8 x 8 pixels is an eighth of that coefficient.
    """
    for grey in (60, 99, 101, 155, 209):
        level, colour, _ = perturbed("jpeg_compression", 4, still(grey))
        step = 16 * 50 / level / 8
        assert np.abs(colour - (128 + step * np.rint((grey - 128) / step))).max() <= 1


@law
def pixelate():
    image = np.random.default_rng(0).integers(0, 256, (120, 160, 3))
    level, colour, _ = perturbed("pixelate", 4, still(image))
    columns = 1 + (np.diff(colour.astype(int), axis=1) != 0).any((0, 2)).sum()
    rows = 1 + (np.diff(colour.astype(int), axis=0) != 0).any((1, 2)).sum()
    assert (columns, rows) == (int(160 * level), int(120 * level))


@law
def black_frames():
    black = PLAN.apply("black_frames", 2, numbered(2000))
    dark = np.array([not (black.load(n)[0].any() or black.load(n)[1].any()) for n in range(2000)])
    level = PLAN.perturbations["black_frames"].levels[1]
    assert dark.mean() == pytest.approx(level / 100, abs=0.03) and not dark[0]


# -- depth


def run_lengths(mask):
    """Mean length of the runs of ones in the rows of a mask."""
    ends = np.diff(np.pad(mask.astype(int), ((0, 0), (1, 1))), axis=1)
    return mask.sum() / (ends == 1).sum()


@law
def holes():
    """Patches of about 12 pixels: a patch is about as wide where half of the image is missing."""
    missing = []
    for number in range(40):
        level, _, depth_z_m = perturbed("holes", 4, still(), number)
        missing.append(depth_z_m == 0)
    assert np.mean(missing) == pytest.approx(level / 100, abs=0.005)
    assert 0.8 * 12 < run_lengths(np.concatenate(missing)) * (100 - level) / level < 1.5 * 12


@law
def range_cut():
    image = np.float32(0.01 * (U + V) + 0.005)
    level, _, depth_z_m = perturbed("range_cut", 3, still(depth_m=image))
    assert 0 <= level - depth_z_m.max() < 0.0101
    assert np.array_equal(depth_z_m > 0, (image > 0) & (image <= level))


@law
def depth_edge_erosion():
    """A pixel beside a straight edge is in one of the squares of side 7 with this probability."""
    missing = []
    for number in range(60):
        step_m = np.where(U < 80, 1.0, 3.0)
        level, _, depth_z_m = perturbed("depth_edge_erosion", 5, still(depth_m=step_m), number)
        missing.append(depth_z_m[4:-4] == 0)
    share = np.mean(missing, axis=(0, 1))
    (edge,) = np.flatnonzero(share == 1)
    assert 78 <= edge <= 81
    for offset in (-3, -2, 2, 3):
        assert share[edge + offset] == pytest.approx(1 - (1 - level) ** 7, rel=0.15)
    assert share[: edge - 3].max() == share[edge + 4 :].max() == 0


@law
def misregistered():
    level, colour, depth_z_m = perturbed("misregistered", 2, still(U[..., None], 1 + U))
    assert np.array_equal(depth_z_m[:, int(level) :], (1 + U)[:, : -int(level)])
    assert not depth_z_m[:, : int(level)].any() and np.array_equal(colour[..., 0], U)


@law
def interference():
    """Windows of 5 pixels, half of them without depth, the others wrong by up to 16 pixels of
    disparity; the baseline is 75 mm.
    """
    windows, missing, wrong_px = 0, 0, []
    for number in range(40):
        level, _, depth_z_m = perturbed("interference", 3, still(depth_m=0.5), number)
        blocks = depth_z_m.reshape(24, 5, 32, 5).swapaxes(1, 2).reshape(-1, 25)
        assert (blocks == blocks[:, :1]).all()
        windows += len(blocks)
        missing += (blocks[:, 0] == 0).sum()
        changed = blocks[(blocks[:, 0] > 0) & (np.abs(blocks[:, 0] - 0.5) > 1e-6), 0]
        assert len(np.unique(changed)) > 0.95 * len(changed)
        wrong_px.extend(FX * 0.075 * (1 / changed - 2))
    assert missing / windows == pytest.approx(level / 200, abs=0.01)
    assert len(wrong_px) / windows == pytest.approx(level / 200, abs=0.01)
    assert -16 <= np.min(wrong_px) < -15.9 and 15.9 < np.max(wrong_px) <= 16.001


@law
def wrapped_phase():
    slant = np.sqrt(1 + ((U - 79.5) / FX) ** 2 + ((V - 59.5) / 120) ** 2)
    true_m = 1 + 0.04 * U
    level, _, depth_z_m = perturbed("wrapped_phase", 5, still(depth_m=true_m))
    range_m = 299792458 / (2e6 * level)
    turns = np.floor(true_m * slant / range_m)
    assert (turns == 0).any() and (turns > 1).any()
    error_m = depth_z_m * slant - (true_m * slant - turns * range_m)
    assert np.percentile(np.abs(error_m), 99) < 1e-5  # at the jump it may be a turn


@law
def few_zones():
    image = 1 + np.random.default_rng(0).random((120, 160))
    level, _, depth_z_m = perturbed("few_zones", 2, still(depth_m=image))
    side = int(level)
    zones = image.reshape(120 // side, side, 160 // side, side).mean((1, 3))
    assert np.allclose(depth_z_m, np.kron(zones, np.ones((side, side))), rtol=1e-6)


# -- time


@law
def speed():
    level = PLAN.perturbations["speed"].levels[1]
    assert PLAN.apply("speed", 2, still()).numbers == tuple(range(0, 60, int(level)))


@law
def dropped_frames():
    level = PLAN.perturbations["dropped_frames"].levels[1]
    numbers = PLAN.apply("dropped_frames", 2, still(frames=3000)).numbers
    assert len(numbers) / 3000 == pytest.approx(1 - level / 100, abs=0.03) and numbers[0] == 0


@law
def frozen_frames():
    """Runs of 6 frames."""
    level = PLAN.perturbations["frozen_frames"].levels[1]
    frozen = PLAN.apply("frozen_frames", 2, numbered(6000))
    shown = np.array([frozen.load(n)[0][0, 0, 0] for n in range(6000)])
    repeats = shown != np.arange(6000) % 250 + 1
    runs = repeats.reshape(-1, 6)[1:]
    assert (runs == runs[:, :1]).all() and runs.mean() == pytest.approx(level / 100, abs=0.04)
    assert (shown[1:] == shown[:-1])[repeats[1:]].all()
    share = level / 100
    changes = (runs[1:, 0] != runs[:-1, 0]).mean()
    assert changes == pytest.approx(2 * share * (1 - share), abs=0.06)


def sideways(grey_of, px_per_s):
    """A wall 1 m away with the grey value grey_of(column at 1 s), seen by a camera that moves to the
    right by a whole number of pixels a frame.
    """
    found = still(depth_m=1.0, twist_per_s=np.array([px_per_s / FX, 0, 0, 0, 0, 0]))

    def load(number):
        grey = grey_of(U + (number - HZ) * px_per_s // HZ)
        return np.uint8(np.clip(grey, 0, 255))[..., None].repeat(3, -1), found.load(number)[1]

    return replace(found, load=load)


def line(column):
    """A white line, 6 px wide."""
    return 255 * (np.abs(column - 79.5) < 3)


@law
def motion_blur():
    """Light is spread over the way of the image during the exposure; a longer exposure than a frame
    lowers the frame rate.
    """
    level, colour, _ = perturbed("motion_blur", 1, sideways(line, 90), HZ)
    profile = linear_from_srgb8(colour)[60, :, 0]
    position = (profile * np.arange(160)).sum() / profile.sum()
    spread = (profile * (np.arange(160) - position) ** 2).sum() / profile.sum()
    assert np.sqrt(12 * spread) == pytest.approx(np.hypot(90 * level / 1e3, 6), rel=0.05)
    assert position == pytest.approx(79.5, abs=0.3)
    assert PLAN.apply("motion_blur", 1, still()).numbers == tuple(range(0, 60, 4))


class Recording(Segment):
    """A segment that lists the times of the poses it is asked for."""

    def pose(self, stamp_s):
        self.asked_s.append(float(stamp_s))
        return super().pose(stamp_s)


@pytest.mark.parametrize(("px_per_s", "instants"), [(90, 6), (180, 12), (360, 16), (540, 16)])
def test_an_exposure_has_an_instant_for_every_two_pixels_up_to_sixteen(px_per_s, instants):
    segment = Recording(**vars(sideways(line, px_per_s)))
    object.__setattr__(segment, "asked_s", [])
    level, _, _ = perturbed("motion_blur", 1, segment, HZ)
    assert instants == min(16, np.ceil(px_per_s * level / 1e3 / 2))
    assert len(segment.asked_s) == 2 * (1 + instants)  # two poses a view; the first is of its end


def seconds_late(name, severity):
    """The level, and the seconds by which each pixel is seen later than the frame: the grey value of
    the wall is its column, and the camera moves by 240 pixels a second.
    """
    moving = sideways(lambda column: 40 + column, 240)
    level, colour, _ = perturbed(name, severity, moving, HZ)
    return level, (colour[:, 20:140, 0] - 40.0 - U[:, 20:140]) / 240


@law
def rolling_shutter():
    level, late_s = seconds_late("rolling_shutter", 5)
    expected = ((np.arange(120) + 0.5) / 120 - 0.5) * level / 1e3
    assert np.abs(late_s.mean(1) - expected).max() < 0.6 / 240


@law
def out_of_step():
    level, late_s = seconds_late("out_of_step", 4)
    assert late_s.mean() == pytest.approx(level / 1e3, abs=0.6 / 240)


# -- the camera and the initial guess


@law
def calibration_off():
    level = PLAN.perturbations["calibration_off"].levels[4]
    found = PLAN.apply("calibration_off", 5, still())
    expected = 1 + level / 100
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found.camera, name) == pytest.approx(expected * getattr(CAMERA, name))
    assert found.true_camera == CAMERA


class Guesses:
    """An odometer that keeps its initial guesses."""

    name, reference = "guesses", None

    def __init__(self):
        self.found = []

    def prepare(self, frame, camera):
        return frame

    def align(self, reference, current, guess):
        self.found.append(guess)


@law
def guess_off():
    level = PLAN.perturbations["guess_off"].levels[1]
    odometer, off = Guesses(), PLAN.apply("guess_off", 2, still())
    recorder = RecordingOdometer(odometer, off)
    frames = [Frame.of(*still().load(0), stamp_s) for stamp_s in (0.0, 0.1, 0.2)]
    first, *others = (recorder.prepare(frame, CAMERA) for frame in frames)
    for other in others:
        recorder.align(first, other, SE3.identity())
    angles = [np.degrees(np.linalg.norm(guess.log()[3:])) for guess in odometer.found]
    assert angles == pytest.approx([level] * 2)
    axes = [guess.log()[3:] / np.radians(level) for guess in odometer.found]
    assert np.abs(axes[0] - axes[1]).max() > 0.1


# -- objects in the scene


@law
def bare_wall():
    """0.9 m away, painted: it reflects two fifths of the light."""
    level, colour, depth_z_m = perturbed("bare_wall", 3, still(U[..., None]), 30)
    on = depth_z_m != 2
    assert np.array_equal(on, in_middle(level)) and np.allclose(depth_z_m[on], 0.9)
    assert linear_from_srgb8(colour)[on] == pytest.approx(0.4, rel=0.1)
    assert np.array_equal(colour[~on][:, 0], U[~on])
    assert np.allclose(perturbed("bare_wall", 5, still(), 30)[2], 0.9)


@law
def glass():
    """1 m away."""
    level, colour, depth_z_m = perturbed("glass", 4, still(U[..., None]))
    on = depth_z_m != 2
    assert np.array_equal(on, in_middle(level)) and np.allclose(depth_z_m[on], 1)
    assert np.array_equal(colour[..., 0], U)


def test_panes_are_put_before_the_camera_every_second():
    """A camera that turns by 90 degrees a second never sees two of them in the middle."""
    turning = still(frames=91, twist_per_s=np.array([0, 0, 0, 0, np.pi / 2, 0]))
    level = PLAN.perturbations["glass"].levels[0]
    panes = PLAN.apply("glass", 1, turning)
    seen = [np.array_equal(panes.load(n)[1] != 2, in_middle(level)) for n in range(91)]
    assert np.flatnonzero(seen).tolist() == [15, 45, 75]


def bars(name, width_m):
    """The level, and the mask of vertical bars 1 m before a camera of long focal length."""
    zoomed = PinholeCamera(640, 40, 1200.0, 1200.0, 319.5, 19.5)
    level, colour, depth_z_m = perturbed(name, 1, still(200, camera=zoomed))
    on = (colour != 200).any(-1) if name == "thin_structures" else depth_z_m != 2
    assert (on == on[0]).all()
    ends = np.diff(on[0].astype(int))
    starts, stops = np.flatnonzero(ends == 1), np.flatnonzero(ends == -1)
    widths = stops[stops > starts[0]][: len(starts)] - starts[: len(stops)]
    assert np.abs(widths - 1200 * width_m).max() <= 1
    assert np.abs(np.diff(starts) - 1200 * width_m / (level / 100)).max() <= 1
    return colour, depth_z_m, on


@law
def thin_structures():
    """6 mm wide, dark: they reflect a fiftieth of the light."""
    colour, depth_z_m, on = bars("thin_structures", 0.006)
    assert (depth_z_m == 2).all()
    assert linear_from_srgb8(colour)[on] == pytest.approx(0.02, rel=0.25)


@law
def mirror_bars():
    """40 mm wide, 1 m away."""
    _, depth_z_m, on = bars("mirror_bars", 0.040)
    assert np.allclose(depth_z_m[on], 1)
    level, colour, depth_z_m = perturbed("mirror_bars", 3, still(coordinates()))
    on = depth_z_m == 1
    assert on.mean() == pytest.approx(level / 100, abs=0.02)
    column, row = mirrored_at_the_image_plane()
    assert np.abs(colour[on][:, 0] - column[on]).max() < 1.01
    assert np.abs(colour[on][:, 1] - row[on]).max() < 1.01


@law
def gloss():
    level, colour, _ = perturbed("gloss", 2, still(coordinates()))
    column, row = mirrored_at_the_image_plane()
    shown = np.stack([column, row], -1).astype(np.uint8)
    own, mirrored = (
        linear_from_srgb8(coordinates()[..., :2].astype(np.uint8)),
        linear_from_srgb8(shown),
    )
    expected = srgb8((1 - level / 100) * own + level / 100 * mirrored)
    inside = (slice(8, -8), slice(8, -8))
    assert np.abs(colour[..., :2].astype(int) - expected)[inside].max() <= 2


def test_gloss_smooths_normals_over_nine_pixels():
    """Beside a step of depth, mirrored colours change up to half of that away, and a pixel for the
    difference that gives the normal.
    """
    _, flat, _ = perturbed("gloss", 5, still(coordinates()))
    _, step, _ = perturbed("gloss", 5, still(coordinates(), np.where(U < 80, 2.0, 2.2)))
    changed = np.flatnonzero((flat != step).any(-1)[20:-20].any(0))
    assert (changed.min(), changed.max()) in {(75, 84), (74, 84), (75, 85), (76, 83)}


@law
def moving_object():
    """1 m away, it sways by 10 cm to each side every two seconds, at first to the right."""
    level, _, depth_z_m = perturbed("moving_object", 3, still(), 0)
    assert np.array_equal(depth_z_m == 1, in_middle(level))
    for number, side in ((15, 1), (45, -1), (30, 0)):
        _, colour, depth_z_m = perturbed("moving_object", 3, still(), number)
        assert U[depth_z_m == 1].mean() - 79.5 == pytest.approx(side * FX * 0.1, abs=0.5)
        assert len(np.unique(colour[depth_z_m == 1], axis=0)) > 20


# -- light, air and lens


@law
def smoke():
    """A contrast of 5 % is left at the visibility; far away is the light of the air, a half; depth
    is missing where 2 % of the light or less returns.
    """
    row, column = 60, 80
    level = PLAN.perturbations["smoke"].levels[3]
    for distance_m, kept in ((level, 0.05), (level / 2, np.sqrt(0.05))):
        white, black = (
            linear_from_srgb8(perturbed("smoke", 4, still(grey, distance_m))[1])[row, column]
            for grey in (255, 0)
        )
        assert white - black == pytest.approx(kept, abs=0.006)
        assert black == pytest.approx(0.5 * (1 - kept), abs=0.006)
    last_m = level * np.log(0.02) / (2 * np.log(0.05))
    seen = [
        perturbed("smoke", 4, still(depth_m=share * last_m))[2][row, column]
        for share in (0.98, 1.02)
    ]
    assert seen[0] > 0 and seen[1] == 0


@law
def flicker():
    """100 Hz, and the rows are read within 20 ms."""
    for number in (0, 4):
        level, colour, _ = perturbed("flicker", 2, still(128), number)
        ratio = (linear_from_srgb8(colour) / linear_from_srgb8(np.uint8([[[128]]])))[..., 0]
        row_s = number / HZ + (np.arange(120) + 0.5) / 120 * 0.020
        expected = 1 + level / 100 * np.sin(2 * np.pi * 100 * row_s)
        assert np.abs(ratio.mean(1) - expected).max() < 0.01


def shade(number, stamps_s=None):
    """The level, and the share of light of each pixel that a shadow takes on a wall 2 m away whose
    image is the floor: the camera looks down.
    """
    wall = still(200)
    down = SE3(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 2.0]))
    truth = Trajectory(wall.truth.stamps_s, SE3.from_matrix(np.tile(down.matrix, (60, 1, 1))))
    wall = replace(wall, truth=truth, stamps_s=stamps_s or wall.stamps_s)
    level, colour, _ = perturbed("moving_shadows", 3, wall, number)
    return level, 1 - (linear_from_srgb8(colour) / linear_from_srgb8(np.uint8([[[200]]])))[..., 0]


@law
def moving_shadows():
    """At 0.5 m/s along x; the cells of their random field are 10 cm wide, its patches about two."""
    level, first = shade(0)
    assert first.max() == pytest.approx(level / 100, abs=0.01) and first.min() < 0.01
    _, later = shade(12)
    moved_px = round(0.5 * 12 / HZ * FX / 2)
    assert np.abs(later[:, moved_px:] - first[:, :-moved_px]).max() < 0.02
    width_m = run_lengths(first > level / 200) * 2 / FX
    assert 0.15 < width_m < 0.3


def test_shadows_repeat_after_64_of_their_widths():
    period_s = 64 * 0.1 / 0.5
    stamps_s = {0: 0.0, 1: period_s / 2, 2: period_s}
    first, half, whole = (shade(number, stamps_s)[1] for number in range(3))
    assert np.abs(whole - first).max() < 0.02 < np.abs(half - first).max()


@law
def emitter_dots():
    """A dot a square of 16 pixels, moved by the disparity of a baseline of 55 mm, with `strength`
    times the light at 1 m and falling with the squared distance.
    """
    camera = PinholeCamera(1024, 1024, 3000.0, 3000.0, 511.5, 511.5)  # the whole pattern
    gains = []
    for disparity_px in (150, 75):
        distance_m = 3000 * 0.055 / disparity_px
        level, colour, _ = perturbed("emitter_dots", 2, still(60, distance_m, camera=camera))
        slant2 = np.square(camera.rays()).sum(-1)
        ratio = (linear_from_srgb8(colour) / linear_from_srgb8(np.uint8([[[60]]])))[..., 0]
        gains.append((ratio - 1) * distance_m**2 * slant2)
    near, far = gains
    assert near.max() == pytest.approx(level, rel=0.05)
    assert np.abs(far[:, 75:] - near[:, :-75]).max() < 0.1 * level
    v, u = np.nonzero(near[1:-1, 1:-1] > 0.5 * level)
    around = [near[v + 1 + i, u + 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    dots = (near[v + 1, u + 1] == np.max(around, axis=0)).sum()
    assert dots == pytest.approx(1024**2 / 16**2, rel=0.1)


@law
def lens_dirt():
    """Spots of about 24 pixels with the light of dark dirt, 2 %. Their edge fades over 0.6 standard
    deviations of the random field.
    """
    level, white, _ = perturbed("lens_dirt", 4, still(255))
    cover = (1 - linear_from_srgb8(white)[..., 0]) / (1 - 0.02)
    assert (cover > 0.5).mean() == pytest.approx(level / 100, abs=0.01)
    _, black, _ = perturbed("lens_dirt", 4, still(0))
    assert linear_from_srgb8(black)[..., 0].max() == pytest.approx(0.02, rel=0.05)
    assert np.array_equal(black, perturbed("lens_dirt", 4, still(0), 3)[1])
    field = random_field(still(), 0, 24)
    fading = (cover > 0.02) & (cover < 0.98)
    assert np.ptp(field[fading]) == pytest.approx(0.6 * 0.96, rel=0.05)
    assert 0.8 * 24 < run_lengths(field < np.median(field)) < 1.7 * 24


# -- people


def crowd(number, severity=5):
    """The level, the points (n, 3) of people and their colours (n, 3), around a camera at the
    origin that looks along x, 1.4 m high, with nothing else to see.
    """
    forward = SE3(np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0.0]]), np.array([0, 0, 1.4]))
    empty = still(depth_m=0.0)
    truth = Trajectory(empty.truth.stamps_s, SE3.from_matrix(np.tile(forward.matrix, (60, 1, 1))))
    level, colour, depth_z_m = perturbed("people", severity, replace(empty, truth=truth), number)
    on = depth_z_m > 0
    return level, forward.apply(CAMERA.unproject(depth_z_m)[on]), colour[on]


def axes(level, seconds):
    """Positions of the people: 2.2 m away, at 1 m/s; the first is ahead at the middle frame."""
    angle = 2 * np.pi * np.arange(level) / level + seconds * 1.0 / 2.2
    return 2.2 * np.stack([np.cos(angle), np.sin(angle)], -1), angle


@law
def people():
    """Cylinders of 0.25 m radius, up to 0.35 m above the camera."""
    for number in (30, 45):
        level, points, _ = crowd(number)
        places, _ = axes(level, (number - 30) / HZ)
        apart_m = np.linalg.norm(points[:, None, :2] - places, axis=-1)
        assert np.abs(apart_m.min(1) - 0.25).max() < 1e-3
        assert points[:, 2].max() == pytest.approx(1.4 + 0.35, abs=0.02)
        in_view = np.abs(np.arctan2(places[:, 1], places[:, 0])) < np.arctan(79.5 / FX)
        assert len(np.unique(apart_m.argmin(1))) >= in_view.sum() >= 1


def test_clothes_have_12_patches_around_and_8_a_metre():
    level, points, colours = crowd(30)
    places, angle = axes(level, 0)
    offset = points[:, :2] - places[0]
    first = np.abs(np.linalg.norm(offset, axis=1) - 0.25) < 1e-3
    around = (np.arctan2(offset[:, 1], offset[:, 0]) - angle[0])[first] / (2 * np.pi) * 12
    down = (1.4 + 0.35 - points[first, 2]) * 8
    clear = (np.abs(around - np.rint(around)) > 0.02) & (np.abs(down - np.rint(down)) > 0.02)
    patches = np.stack([np.floor(around) % 12, np.floor(down)], -1)[clear]
    seen = np.unique(np.column_stack([patches, colours[first][clear]]), axis=0)
    assert len(seen) == len(np.unique(patches, axis=0)) == len(np.unique(seen[:, 2:], axis=0)) > 20


# -- views between frames


@pytest.mark.parametrize(("step", "is_one_surface"), [(0.05, True), (0.075, False)])
def test_depths_that_differ_by_three_percent_between_pixels_are_two_surfaces(step, is_one_surface):
    """At 0.49 px between two depths, the interpolated one differs from the nearer one by about
    half of the step.
    """
    depth_z_m = np.where(U < 80, 1.0, 1 + step).astype(np.float32)
    moved = Shift(np.stack([np.full_like(depth_z_m, 0.49), 0 * depth_z_m, 0 * depth_z_m]))
    found = moved.depth(depth_z_m)[60, 79]
    assert found == pytest.approx(1 + 0.49 * step if is_one_surface else 1.0, abs=step / 16)
