"""Errors caused by user input or the environment: a base class, and a subclass per family.

A message is one line, lower case, and names the file, topic, frame, joint or field, the value
found, the expected one and a remedy. The command line prints it and exits with status 1.
"""

from collections.abc import Iterable
from difflib import get_close_matches

MAX_SUGGESTED = 12
"""Maximum number of known names that a hint lists."""


class TccmError(Exception):
    """Base class of all errors of this package."""


class ConfigError(TccmError):
    """A configuration key or value that is unknown or out of range."""


class BagError(TccmError):
    """A bag that is missing, empty, truncated or damaged."""


class TopicError(TccmError):
    """A topic that is not in the bag, or has another type."""


class FrameError(TccmError):
    """A frame or joint that cannot be found, or an ambiguity between several."""


class UrdfError(TccmError):
    """A robot description that cannot be read."""


class LogError(TccmError):
    """A CARMEN log, trajectory or relations file that cannot be read."""


class MapError(TccmError):
    """A saved map that is missing, damaged or of another version."""


class RequestError(TccmError):
    """A request about the map that was not answered; the message comes from the node."""


class MotionError(TccmError):
    """A joint that cannot be moved, or a robot that moves when it must stand still."""


class OutputError(TccmError):
    """A file or folder that cannot be written."""


class FleetError(TccmError):
    """A fleet of recordings, a catalogue or a merge of maps that cannot be processed."""


class MessageError(TccmError):
    """A message whose content contradicts itself or cannot be used."""


class PictureError(TccmError):
    """A picture that cannot be read."""


class MissingExtraError(TccmError):
    """A feature that needs a package which is not installed."""


def suggest(name: str, known: Iterable[str]) -> str:
    """Return a hint with the most similar of the known names, or a list of them.

    Parameters
    ----------
    name
        Unknown name.
    known
        Known names.

    Returns
    -------
    str
        A clause to append to a message, for example ``; did you mean 'odom'?``.
    """
    names = sorted(set(known))
    near = get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"; did you mean '{near[0]}'?"
    if not names:
        return "; there are none"
    shown = ", ".join(names[:MAX_SUGGESTED]) + (", ..." if len(names) > MAX_SUGGESTED else "")
    return f"; there are: {shown}"


def one_line(error: BaseException, *, limit: int = 200) -> str:
    """Return the text of an error as one line of at most `limit` characters.

    For an OSError only its description is returned ("no such file or directory"), because the
    surrounding message names the file.
    """
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror[:1].lower() + error.strerror[1:]
    text = " ".join(text.split()) or type(error).__name__
    return text if len(text) <= limit else text[: limit - 3] + "..."
