"""A Python file of a user's own, run as a module, and what goes wrong in it, in one line."""

from __future__ import annotations

import hashlib
import inspect
import linecache
import sys
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import TYPE_CHECKING, Any

from protocols.errors import InputError, Problem
from protocols.files import read_text

if TYPE_CHECKING:
    import os

__all__ = ["classes_of", "failure", "place_of", "run_file", "sha256_of"]


def run_file(path: str | os.PathLike[str], kind: str) -> tuple[ModuleType, str]:
    """Run a file, and return it as a module, and its text.

    The name of the module depends on kind and path alone, so that another process finds the same.

    Parameters
    ----------
    kind
        What is looked for in it, as ``effects``.

    Raises
    ------
    InputError
        The file cannot be read or run; one line with file and line.
    """
    source, where = str(path), Path(path).resolve()
    text = read_text(path)
    name = f"evs_bench_user_{kind}_{hashlib.sha256(str(where).encode()).hexdigest()[:16]}"
    module = ModuleType(name)
    module.__file__ = str(where)
    before = sys.modules.get(name)
    sys.modules[name] = module  # a dataclass looks itself up there, and so does pickle
    linecache.checkcache(source)
    try:
        exec(compile(text, source, "exec", dont_inherit=True), vars(module))  # noqa: S102 - the user named this file to be run
    except BaseException as error:
        sys.modules.pop(name)
        if before is not None:
            sys.modules[name] = before
        if isinstance(error, SyntaxError) and error.filename == source:
            line, column = error.lineno or 0, error.offset or 0
            raise InputError(Problem(f"is no Python: {error.msg}", source, line, column)) from None
        if isinstance(error, Exception | SystemExit):
            raise InputError(failure(error, source, source)) from error
        raise
    return module, text


def classes_of(module: ModuleType, base: type[Any]) -> tuple[type[Any], ...]:
    """Return the classes derived from `base` that a module defines itself."""
    classes = (v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__)
    return tuple(dict.fromkeys(c for c in classes if issubclass(c, base)))


def place_of(cls: type[Any], source: str) -> str:
    """Return file and line of a class."""
    try:
        return f"{source}:{inspect.getsourcelines(cls)[1]}"
    except OSError:
        return source


def failure(error: BaseException, file: str, otherwise: str) -> str:
    """Return an error in a user's file as one line, with the last line of `file` that it passed through."""
    lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == file]
    text = " ".join(str(error).split())
    return f"{f'{file}:{lines[-1]}' if lines else otherwise}: {type(error).__name__}: {text}".removesuffix(": ")


def sha256_of(file: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
