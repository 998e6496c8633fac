"""Effects that are not built in: loading a user's files, and what a run says of them so that it can be repeated."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from sim_backend.pixel.effects import effect_source, load_effect_files, loaded_effect_files

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from sim_backend.pixel.effects import EffectSource

__all__ = [
    "load_effect_files",
    "load_same_effect_files",
    "loaded_effect_files",
    "require_sources",
    "same_effects",
    "sources_in_use",
]

_SHOWN: Final = 12  # digits of a SHA-256 in a message


def load_same_effect_files(files: Sequence[tuple[str, str]]) -> None:
    """Load files in another process: each path with the SHA-256 that it had where the run was begun.

    Raises
    ------
    InputError
        A file cannot be used, or is another than it was there.
    """
    for source, (path, sha256) in zip(load_effect_files(path for path, _ in files), files, strict=True):
        if source.sha256 != sha256:
            raise InputError(
                f"{path}: is another file for this worker (SHA-256 {source.sha256[:_SHOWN]}) than when the run was "
                f"begun ({sha256[:_SHOWN]}); expected the same"
            )


def same_effects() -> Callable[[], object] | None:
    """Return what another process does first: it loads the user's own effects that are loaded here.

    None where there are none.
    """
    files = [(source.path, source.sha256) for source in loaded_effect_files()]
    return partial(load_same_effect_files, files) if files else None


def sources_in_use(station: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return where the effects came from that a resolved station names and that are not built in, as plain values."""
    found: dict[str, EffectSource] = {}
    for effect_id in _named_effects(station):
        source = effect_source(effect_id)
        if source is not None:
            found[source.name] = source
    return [_as_dict(source) for source in found.values()]


def require_sources(sources: object, where: object) -> None:
    """See that the effects of :func:`sources_in_use` are loaded, and from the same files, byte by byte.

    Parameters
    ----------
    sources
        As the run in `where` has them; anything else than a list of mappings says nothing.

    Raises
    ------
    InputError
        Files are missing, or others than those of the run; one line for each.
    """
    entries = [entry for entry in sources if isinstance(entry, dict)] if isinstance(sources, list) else []
    problems = [problem for entry in entries for problem in _problems(entry, where)]
    if problems:
        raise InputError(*dict.fromkeys(problems))


def _problems(entry: Mapping[str, Any], where: object) -> Iterator[str]:
    """Yield what is missing, or another than in the run."""
    name, sha256 = entry.get("name"), str(entry.get("sha256"))
    from_file = entry.get("loaded") == "file"
    for effect_id in entry.get("effects", []):
        source = effect_source(effect_id)
        taken = f"{where}: was taken with the effect {effect_id} of {name}"
        if source is None and from_file:
            yield f"{taken} (SHA-256 {sha256[:_SHOWN]}); name that file with --effects"
        elif source is None:
            yield f"{taken}, an entry point of {entry.get('package')}; install that package"
        elif source.sha256 != sha256:
            yield f"{taken} (SHA-256 {sha256[:_SHOWN]}), but {source.name} is another ({source.sha256[:_SHOWN]})"


def _as_dict(source: EffectSource) -> dict[str, Any]:
    more = {"package": source.package, "text": source.text}
    return {
        "name": source.name,
        "loaded": source.loaded,
        "sha256": source.sha256,
        "effects": list(source.ids),
        **{key: value for key, value in more.items() if value},
    }


def _named_effects(value: object) -> Iterator[str]:
    """Yield the names in all sections called `effects`."""
    if isinstance(value, list):
        for item in value:
            yield from _named_effects(item)
    if not isinstance(value, dict):
        return
    section = value.get("effects")
    if isinstance(section, dict):
        yield from map(str, section)
    for item in value.values():
        yield from _named_effects(item)
