"""`tilthex video`: a film of a log. It is rendered for real, by MuJoCo without a display."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_logs import sentence
from tilthex import log

pytest.importorskip("mujoco", reason="videos need MuJoCo: pip install 'tilthex[experiments]'")
pytest.importorskip("PIL", reason="videos need Pillow: pip install 'tilthex[analysis]'")

from PIL import Image
from tilthex.experiments.video import save

# Its log is flown in real time.
pytestmark = pytest.mark.real_time


def made(*arguments: object) -> subprocess.CompletedProcess[str]:
    """A film that a program of its own makes: MuJoCo chooses its renderer when it is imported."""
    call = [sys.executable, "-m", "tilthex", "video", *map(str, arguments)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if "no video:" in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    return done


def film(path: Path) -> tuple[list[np.ndarray], list[float]]:
    """Pictures of a film, and the duration of each, ms."""
    pictures, durations = [], []
    with Image.open(path) as image:
        for k in range(image.n_frames):
            image.seek(k)
            pictures.append(np.asarray(image.convert("RGB")))
            durations.append(image.info["duration"])
    return pictures, durations


def test_a_log_gives_a_film_of_its_length(path: Path, tmp_path: Path) -> None:
    """A log that breaks off is shown as far as it goes."""
    cut, out, fps, speed = tmp_path / "cut.mcap", tmp_path / "cut.gif", 3.0, 4.0
    cut.write_bytes(path.read_bytes()[: round(0.7 * path.stat().st_size)])
    with pytest.warns(log.LogCut):
        times = log.read(cut, ["/flight"])["/flight"]["log_time"]
    done = made(cut, "--fps", fps, "--speed", speed, "--size", "200x120")
    assert done.stdout == f"{out}\n"
    assert "warning" in done.stderr and done.stderr.count("\n") == 1
    pictures, durations = film(out)
    assert pictures[0].shape == (120, 200, 3)
    expected = 1e3 * (float(times[-1] - times[0]) / speed + 1.0 / fps)
    assert sum(durations) == pytest.approx(expected, abs=1e3 / fps)
    # The time in the corner changes in every picture, and the vehicle rises below it.
    assert all(np.any(one != other) for one, other in itertools.pairwise(pictures))
    below = [picture[40:].astype(int) for picture in pictures]
    assert max(np.abs(below[0] - other).max() for other in below) > 60


@pytest.mark.parametrize("ending", ["gif", "webp"])
def test_a_film_keeps_the_colour_of_a_thin_line(tmp_path: Path, ending: str) -> None:
    """On a picture with many shades of grey and blue."""
    picture = np.random.default_rng(1).integers(90, 250, (120, 160, 1), dtype=np.uint8) * [[[0.9, 0.95, 1.0]]]
    picture[20:60, 80:82] = (220, 0, 0)
    save([picture.astype(np.uint8)] * 2, tmp_path / f"line.{ending}", 10.0)
    pictures, _ = film(tmp_path / f"line.{ending}")
    red, green, blue = pictures[0][30:50, 80:82].reshape(-1, 3).mean(axis=0)
    assert red > 150 and green < 60 and blue < 60


@pytest.mark.parametrize("ending", ["gif", "webp"])
def test_a_film_is_neither_faster_nor_slower(tmp_path: Path, ending: str) -> None:
    """At 30 pictures per second no duration is a number of the format's units."""
    pictures = np.random.default_rng(1).integers(0, 255, (31, 8, 8, 3), dtype=np.uint8)
    save(pictures, tmp_path / f"noise.{ending}", 30.0)
    _, durations = film(tmp_path / f"noise.{ending}")
    assert len(durations) == 31
    assert sum(durations) == pytest.approx(1e3 * 31 / 30, abs=5.1)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["--out", "flight.mp4"],
            "flight.mp4 is no name of a video; expected one that ends with .gif or .webp",
        ),
        (["--fps", "0"], "expected 1 to 50"),
        (["--fps", "nan"], "expected 1 to 50"),
        (["--speed", "0"], "expected a positive number"),
        (["--speed", "inf"], "expected a positive number"),
        (["--size", "640"], "such as 640x480"),
        (["--size", "4000x480"], "4000x480; expected 64x64 to 1280x960 pixels"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(
    path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert says in sentence(capsys, ["video", path, *arguments])


def test_a_file_that_is_no_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = tmp_path / "empty.mcap"
    empty.touch()
    assert "empty.mcap" in sentence(capsys, ["video", empty])
    assert "none.mcap" in sentence(capsys, ["video", tmp_path / "none.mcap"])
    assert not list(tmp_path.glob("*.gif"))
