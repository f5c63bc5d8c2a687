"""An effect that fits one solver only."""

PARAMETERS = ()
SOLVERS = ("md",)


def build(values: dict, columns: tuple, solver: str) -> None:
    """Never called."""
