"""Making a run of recordings that were made elsewhere."""

from __future__ import annotations

from bench.importing.importer import RECORDINGS_FILE, import_folder

__all__ = ["RECORDINGS_FILE", "import_folder"]
