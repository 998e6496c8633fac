"""JSON Schema of a protocol file, for editors that complete and check YAML."""

from __future__ import annotations

from typing import Any

from protocols.schema import Protocol

__all__ = ["protocol_json_schema"]


def protocol_json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of format ``evs-bench-protocol/1``.

    It knows keys, types and ranges. What keys must be together is checked when a protocol is read.
    """
    draft = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return draft | Protocol.model_json_schema() | {"title": "EVS bench protocol"}
