"""`python -m taichi_sand` is the command `taichi-sand`."""

from taichi_sand.cli.main import main

if __name__ == "__main__":
    main()
