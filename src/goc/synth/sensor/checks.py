"""Ranges of settings, refused in the house's words."""

from goc.errors import ConfigError


def check_ranges(owner: object, option: str, limits: dict[str, tuple[float | int, float | int]]) -> None:
    """Check fields of a configuration.

    Args:
        owner: the configuration.
        option: how the command line calls it, such as "kinect".
        limits: lowest and highest value of each field; NaN is outside all of them.

    Raises:
        ConfigError: a field is outside.
    """
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:
            dotted = f"{option}.{name}".lstrip(".").replace("_", "-")
            raise ConfigError(f"--{dotted} is {value:g}: needs {low:g} to {high:g}.")
