"""Films: MP4, looping GIF, the last frame as PNG, or a folder of PNG frames.

Everything is written to a hidden folder beside the target and moved into place when it is complete: an interruption leaves what
was there before.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
from PIL import Image

from taichi_sand.scene.errors import SandError
from taichi_sand.view.picture import image

if TYPE_CHECKING:
    from taichi_sand.simulation import Simulation

Write = Callable[[np.ndarray], None]
Progress = Callable[[float], None]

ENDINGS = (".mp4", ".gif", ".png")
GIF_FPS, GIF_MOST_FPS = 25, 50
"""Frames a second of a GIF unless told otherwise, and at most: its clock ticks in 1/100 s, and viewers slow down faster ones."""
ENCODER_THREADS = 2
"""A constant, because it is part of what the encoder writes."""
X264 = f"-preset veryfast -crf 22 -threads {ENCODER_THREADS} -movflags +faststart".split()
BT709 = "-vf scale=out_color_matrix=bt709:out_range=tv -colorspace bt709 -color_primaries bt709 -color_trc bt709".split()
LOSSLESS = f"-preset ultrafast -qp 0 -threads {ENCODER_THREADS}".split()


def film(
    sim: "Simulation", out: str | Path, *, seconds: float | None = None, fps: int | None = None, progress: Progress | None = None
) -> None:
    """Simulates on and films it.

    Args:
        sim: goes on from where it is.
        out: ends in `.mp4`, `.gif`, `.png` (the last frame only) or `/` (a folder of PNG frames).
        seconds: simulated time; the scene's duration if None.
        fps: frames per simulated second; the scene's if None. The last frame shows the end.
        progress: called with the share done.

    Raises:
        SandError: `out` cannot be written as what it is called.
    """
    target, ending = destination(out)
    seconds = sim.scene.duration if seconds is None else seconds
    rate = frame_rate(sim, ending, fps)
    with scratch_beside(target) as scratch:
        made = scratch / target.name
        if ending == ".png":
            sim.advance(seconds, progress)
            Image.fromarray(image(sim)).save(made, optimize=True)
        else:
            with WRITERS[ending](made, rate) as write:
                for share in steps_of(sim, seconds, rate):
                    write(image(sim))
                    if progress:
                        progress(share)
        put_in_place(made, target, scratch)


def destination(out: str | Path) -> tuple[Path, str]:
    """Where a film goes and of which kind it is; refuses what cannot become a film before anything is simulated."""
    text = os.fspath(out)
    target = Path(text)
    if text.endswith(("/", os.sep)) or target.is_dir():
        others = sorted(p.name for p in target.iterdir() if not is_frame(p)) if target.is_dir() else []
        if others or target.is_file():
            reason = f"holds other files ({others[0]})" if others else "is a file"
            raise SandError(f"{text}: {reason}; frames go to a folder that is new, empty or holds nothing but frames")
        return target.absolute(), "/"
    ending = target.suffix.lower()
    if ending not in ENDINGS:
        raise SandError(f"{text}: a film ends in {', '.join(ENDINGS)}, or in / for a folder of frames")
    return target.absolute(), ending


def is_frame(path: Path) -> bool:
    """Whether a file is one that an earlier film may have put into its folder."""
    return path.name.startswith("frame_") and path.suffix == ".png"


def frame_rate(sim: "Simulation", ending: str, fps: int | None) -> int:
    """Frames a second of this kind of film."""
    if fps is None:
        return min(sim.scene.view.fps, GIF_FPS) if ending == ".gif" else sim.scene.view.fps
    if fps < 1 or (ending == ".gif" and fps > GIF_MOST_FPS):
        most = f" and at most {GIF_MOST_FPS} in a GIF" if ending == ".gif" else ""
        raise SandError(f"{fps} frames a second cannot be filmed; at least 1{most}")
    return fps


def steps_of(sim: "Simulation", seconds: float, fps: int) -> Iterator[float]:
    """Advances from frame to frame; yields the share of the film that is done."""
    start, frames = sim.time, max(1, round(seconds * fps))
    for frame in range(1, frames + 1):
        end = start + (seconds if frame == frames else frame / fps)
        sim.advance(max(0.0, end - sim.time))
        yield frame / frames


@contextmanager
def scratch_beside(target: Path) -> Iterator[Path]:
    """A hidden folder beside `target`, gone afterwards whatever happens."""
    target.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def put_in_place(made: Path, target: Path, scratch: Path) -> None:
    """Moves a finished file or folder to where it belongs; a folder that stood there goes with the scratch folder."""
    if not target.is_dir():
        os.replace(made, target)
        return
    old = scratch / "old"
    os.rename(target, old)
    try:
        os.rename(made, target)
    except BaseException:
        os.rename(old, target)
        raise


@contextmanager
def video(path: Path, fps: int, codec: str, pixels: str, options: list[str]) -> Iterator[Write]:
    """Writes frames to a video file; they must be of one size."""
    encoder = None

    def write(frame: np.ndarray) -> None:
        nonlocal encoder
        if encoder is None:
            encoder = imageio_ffmpeg.write_frames(
                str(path), (frame.shape[1], frame.shape[0]), fps=fps, codec=codec, pix_fmt_out=pixels, output_params=options,
                macro_block_size=1, quality=None,
            )  # fmt: skip
            encoder.send(None)
        encoder.send(frame)

    try:
        yield write
    finally:
        if encoder is not None:
            encoder.close()


@contextmanager
def mp4(path: Path, fps: int) -> Iterator[Write]:
    """H.264 that plays everywhere; a picture of odd width gets its last column twice."""
    with video(path, fps, "libx264", "yuv420p", [*X264, *BT709]) as write:
        yield lambda frame: write(np.ascontiguousarray(np.pad(frame, ((0, 0), (0, frame.shape[1] % 2), (0, 0)), mode="edge")))


@contextmanager
def gif(path: Path, fps: int) -> Iterator[Write]:
    """A looping GIF whose frames share the palette that fits all of them; no dither, so that still parts cost nothing."""
    whole, colours = path.with_suffix(".mkv"), path.with_suffix(".palette.png")
    with video(whole, fps, "libx264rgb", "rgb24", LOSSLESS) as write:
        yield write
    ffmpeg("-i", whole, "-vf", "palettegen=stats_mode=full", colours)
    ffmpeg("-i", whole, "-i", colours, "-lavfi", "paletteuse=dither=none:diff_mode=rectangle", "-loop", "0", path)


def ffmpeg(*arguments: str | Path) -> None:
    """Runs ffmpeg; its complaints become the error."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *map(str, arguments)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"ffmpeg failed: {done.stderr.strip()}")


@contextmanager
def frames(path: Path, fps: int) -> Iterator[Write]:
    """A folder of numbered PNG files."""
    path.mkdir()
    count = 0

    def write(frame: np.ndarray) -> None:
        nonlocal count
        Image.fromarray(frame).save(path / f"frame_{count:05d}.png")
        count += 1

    yield write


WRITERS = {".mp4": mp4, ".gif": gif, "/": frames}
