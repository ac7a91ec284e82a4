"""Everything that iris-sysid raises on purpose.

::

    IrisError                  one stated failure: says what was wrong, with the value, and what to do
    ├── VideoError             a file that cannot be read as frames with times
    ├── TrackingError          frames were read, but nothing could be followed in them
    ├── CalibrationError       a scale, board or marks file that does not fix metres per pixel
    ├── DataError              arrays or tables that do not mean what they should (also a ValueError)
    ├── FitError               a model that cannot be fitted to this trajectory at all
    ├── UnknownNameError       a name that no registered item has (also a KeyError)
    ├── PluginError            a plugin file, or a foreign package, that the registry refuses
    └── OutputError            a result that cannot be written to the requested place

A fit that ran and failed is not an exception: it is a ``FitResult`` with a status and the remedy.
"""

from collections.abc import Mapping, Sequence


class IrisError(Exception):
    """Base of every deliberate error; its text is complete and fit for a user to read."""


class VideoError(IrisError):
    """The file cannot be read as frames with times."""


class TrackingError(IrisError):
    """Frames were read, but nothing could be followed in them."""


class CalibrationError(IrisError):
    """The scale, board or marks do not fix metres per pixel."""


class DataError(IrisError, ValueError):
    """Arrays or tables do not mean what they should.

    ``columns`` shows how to name the columns of a table that does not say what they hold, by quantity; ``text`` is the
    message without it.
    """

    def __init__(self, text: str = "", *, columns: Mapping[str, str] | None = None) -> None:
        super().__init__(text)
        self.text = text
        self.columns = dict(columns or {})

    def __str__(self) -> str:
        return f"{self.text}, e.g. columns={self.columns}" if self.columns else self.text

    @property
    def typed_columns(self) -> str:
        """The columns as they are typed, ``t=Time,theta[deg]=Angle``; empty where none are known."""
        return ",".join(f"{name}={title}" for name, title in self.columns.items())


class FitError(IrisError):
    """The model cannot be fitted to this trajectory at all; ``to_start`` names values that lack a starting value."""

    def __init__(self, text: str = "", *, to_start: Sequence[str] = ()) -> None:
        super().__init__(text)
        self.to_start = tuple(to_start)


class UnknownNameError(IrisError, KeyError):
    """No registered item has that name; the text lists the names there are."""

    def __str__(self) -> str:  # KeyError would show the repr
        return str(self.args[0]) if self.args else ""


class PluginError(IrisError):
    """A plugin file, or a foreign package of the same import name, is refused."""


class OutputError(IrisError):
    """A result cannot be written to the requested place."""
