"""Makes the small pictures of the scenes that the page in a browser lists, of those in renders/: `python docs/thumbnails.py`."""

from pathlib import Path

from PIL import Image, ImageOps

ROOT = Path(__file__).parents[1]
SIZE = (168, 112)
"""Of a thumbnail [px]; some 2 kB each."""


def main() -> None:
    """Every scene that has a picture called as it is; of a film, its last frame."""
    folder = ROOT / "taichi_sand" / "view" / "page" / "scenes"
    folder.mkdir(exist_ok=True)
    for scene in sorted((ROOT / "scenes").glob("*.toml")):
        found = next((path for ending in (".png", ".gif") if (path := ROOT / "renders" / f"{scene.stem}{ending}").exists()), None)
        if found is None:
            print(f"{scene.stem}: there is no picture of it in renders/")
            continue
        with Image.open(found) as picture:
            picture.seek(getattr(picture, "n_frames", 1) - 1)
            small = ImageOps.fit(picture.convert("RGB"), SIZE, Image.Resampling.LANCZOS, centering=(0.5, 0.7))
        small.save(folder / f"{scene.stem}.webp", quality=60, method=6)


if __name__ == "__main__":
    main()
