"""Films: MP4, looping GIF, the last frame as PNG, a folder of PNG frames, or a page that plays; written as files.writing says.

The encoder is a process of its own (ffmpeg): its exit status and its complaints are looked at, and whether its file can be read.
"""

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imageio_ffmpeg
import numpy as np
from PIL import Image

from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.output.html import html
from taichi_sand.view.picture import image

if TYPE_CHECKING:
    from taichi_sand.run.simulation import Simulation

Write = Callable[[Any], None]
Progress = Callable[[float], None]

ENDINGS = (".mp4", ".gif", ".png", ".html")
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
        out: ends in `.mp4`, `.gif`, `.html` (a page that plays), `.png` (the last frame only) or `/` (a folder of PNG frames).
        seconds: simulated time; the scene's duration if None.
        fps: frames per simulated second; the scene's if None. The last frame shows the end.
        progress: called with the share done.

    Raises:
        SandError: `out` cannot be written as what it is called.
    """
    target, ending = destination(out)
    seconds = sim.scene.duration if seconds is None else seconds
    rate = frame_rate(sim, ending, fps)
    with writing.replacing(target, folder=ending == "/") as made:
        if ending == ".png":
            sim.advance(seconds, progress)
            save_png(image(sim), made)
        else:
            with WRITERS[ending](made, rate) as write:
                for share in steps_of(sim, seconds, rate):
                    write(sim if ending == ".html" else image(sim))
                    if progress:
                        progress(share)


def destination(out: str | Path) -> tuple[Path, str]:
    """Where a film goes and of which kind it is; refuses what cannot become a film before anything is simulated."""
    text = os.fspath(out)
    target = Path(text)
    if not text:
        raise SandError(f"a film needs the name of a file; it ends in {', '.join(ENDINGS)}, or in / for a folder of frames")
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
    """Advances from frame to frame, until an event ends the simulation if one does; yields the share of the film that is done."""
    frames = max(1, round(seconds * fps))
    for frame in range(1, frames + 1):
        if sim.stopped and frame > 1:
            return
        sim.advance(seconds - (frames - 1) / fps if frame == frames else 1 / fps)
        yield frame / frames


def check(out: str | Path) -> None:
    """Refuses what a film cannot be written to before anything is simulated; SandError."""
    target, ending = destination(out)
    writing.check(target, folder=ending == "/")


def save_png(picture: np.ndarray, path: Path) -> None:
    """Writes one picture, (height, width, 3) uint8."""
    Image.fromarray(picture).save(path, optimize=True)


@contextmanager
def video(path: Path, name: str, fps: int, codec: str, pixels: str, options: list[str]) -> Iterator[Write]:
    """Writes frames of one size to a video file, towards the film `name`. SandError if the encoder fails, or its file cannot be read."""
    encoder: Encoder | None = None
    count = 0
    shape: tuple[int, ...] = ()

    def write(frame: np.ndarray) -> None:
        nonlocal encoder, count, shape
        if encoder is None:
            size = f"{frame.shape[1]}x{frame.shape[0]}"
            raw = ["-f", "rawvideo", "-vcodec", "rawvideo", "-s", size, "-pix_fmt", "rgb24", "-r", str(fps), "-i", "-", "-an"]
            encoder, shape = Encoder(name, *raw, "-vcodec", codec, "-pix_fmt", pixels, *options, path), frame.shape
        if frame.shape != shape:  # the encoder would cut what follows into pictures of the old size
            size, other = (f"{of[1]} x {of[0]}" for of in (shape, frame.shape))
            raise SandError(f"{name}: a film has pictures of one size, {size} pixels, and not {other}")
        encoder.take(frame)
        count += 1

    try:
        yield write
        if encoder is not None:
            encoder.finish()
            check_video(path, name, count)
    finally:
        if encoder is not None:
            encoder.stop()


class Encoder:
    """ffmpeg at work, fed with pictures; `name` is what it makes."""

    def __init__(self, name: str, *arguments: str | Path) -> None:
        self.name, self.said = name, tempfile.TemporaryFile()
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *map(str, arguments)]
        group = 0 if os.name == "posix" else None  # its own: Ctrl-C in a terminal is for us to answer
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self.said, process_group=group)

    def take(self, frame: np.ndarray) -> None:
        """One picture."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(np.ascontiguousarray(frame).data)
        except OSError:  # it is gone
            self.finish()
            raise SandError(f"{self.name}: cannot be written: the encoder ended before its time") from None

    def finish(self) -> str:
        """No more comes; what it printed. SandError if it failed."""
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.close()
        assert self.process.stdout is not None
        printed = self.process.stdout.read().decode(errors="replace")
        status = self.process.wait()
        if status:
            self.said.seek(0)
            lines = self.said.read().decode(errors="replace").strip().splitlines()
            how = f"was stopped by signal {-status}" if status < 0 else f"failed with status {status}"
            raise SandError(f"{self.name}: cannot be written: the encoder {how}{f': {lines[0][:200]}' if lines else ''}")
        return printed

    def stop(self) -> None:
        """Ends it if it has not ended."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout, self.said):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]


def ffmpeg(name: str, *arguments: str | Path) -> str:
    """Runs ffmpeg to its end to make `name`; what it printed. SandError with what it complained of."""
    encoder = Encoder(name, *arguments)
    try:
        return encoder.finish()
    finally:
        encoder.stop()


def check_video(path: Path, name: str, count: int) -> None:
    """SandError unless a film can be read, and holds so many frames: an encoder may fail and not say so."""
    printed = ffmpeg(name, "-i", path, "-map", "0:v", "-c", "copy", "-f", "null", "-progress", "-", "-nostats", os.devnull)
    found = [line.partition("=")[2] for line in printed.splitlines() if line.startswith("frame=")]
    if found[-1:] != [str(count)]:
        raise SandError(f"{name}: cannot be written: it holds {(found or ['0'])[-1]} of {count} frames")


@contextmanager
def mp4(path: Path, fps: int) -> Iterator[Write]:
    """H.264 that plays everywhere; a picture of odd width gets its last column twice."""
    with video(path, path.name, fps, "libx264", "yuv420p", [*X264, *BT709]) as write:
        yield lambda frame: write(np.ascontiguousarray(np.pad(frame, ((0, 0), (0, frame.shape[1] % 2), (0, 0)), mode="edge")))


@contextmanager
def gif(path: Path, fps: int) -> Iterator[Write]:
    """A looping GIF whose frames share the palette that fits all of them; no dither, so that still parts cost nothing."""
    whole, colours = path.with_suffix(".mkv"), path.with_suffix(".palette.png")
    with video(whole, path.name, fps, "libx264rgb", "rgb24", LOSSLESS) as write:
        yield write
    ffmpeg(path.name, "-i", whole, "-vf", "palettegen=stats_mode=full", colours)
    ffmpeg(path.name, "-i", whole, "-i", colours, "-lavfi", "paletteuse=dither=none:diff_mode=rectangle", "-loop", "0", path)
    check_gif(path)


def check_gif(path: Path) -> None:
    """SandError unless a GIF ends as one does."""
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        if file.read() != b";":
            raise SandError(f"{path.name}: cannot be written: it breaks off")


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


WRITERS = {".mp4": mp4, ".gif": gif, "/": frames, ".html": html}
"""What makes each kind of film: it is given pictures, a page the simulation."""
