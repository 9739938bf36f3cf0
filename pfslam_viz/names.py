"""File names that are no text, or that would say something else on a terminal."""

import os
import unicodedata
from pathlib import Path

from pfslam_viz.errors import InputError


def readable(text: str) -> str:
    """A name as text that any file, viewer and terminal takes: bytes that are no UTF-8, and control characters, as "?".

    Of characters that turn the direction of writing, those that would reach beyond the name are left out as well.
    """
    whole = os.fsencode(text).decode("utf-8", "replace") if _has_surrogates(text) else text
    return "".join("?" if _acts(character) else character for character in whole.replace("\ufffd", "?"))


def path_for_rerun(path: Path) -> str:
    """A path as Rerun takes it, which knows UTF-8 alone. Raises InputError for one that is none."""
    try:
        return os.fsencode(path).decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(
            f"{readable(str(path))}: the name is not UTF-8, and Rerun writes no other; choose another"
        ) from None


def _has_surrogates(text: str) -> bool:
    return any("\ud800" <= character <= "\udfff" for character in text)


def _acts(character: str) -> bool:
    """Whether a character is a control character, or an override or embedding of the direction of writing."""
    return (
        unicodedata.category(character) == "Cc"
        or "\u202a" <= character <= "\u202e"
        or "\u2066" <= character <= "\u2069"
    )
