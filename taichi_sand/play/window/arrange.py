"""Where what is written over the picture lies, so that nothing lies on anything else."""

from taichi_sand.play.window.hud import MARGIN


def arrange(height: int, picture: tuple[int, int], caption: int, numbers: int, notices: int) -> tuple[int, int]:
    """Where the numbers begin, and their room [px]: above the picture if they fit, else below it, else in it below the caption.

    Args:
        height: of the window.
        picture: where it begins and ends.
        caption: where it ends.
        numbers: their height.
        notices: where they begin.
    """
    top, bottom = picture
    if numbers + 2 * MARGIN <= top:
        return MARGIN, numbers
    if bottom + numbers + 2 * MARGIN <= min(height, notices):
        return bottom + MARGIN, numbers
    begin = caption + MARGIN
    return begin, max(0, min(numbers, notices - MARGIN - begin))
