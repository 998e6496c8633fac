"""Problems in files: all at once, each with its place, in the words of the person who wrote the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field

from protocols import load_protocol
from protocols.errors import InputError
from protocols.files import parse_model, read_model, read_text

if TYPE_CHECKING:
    from pathlib import Path

FIVE_MISTAKES = """\
format: evs-bench-protocol/1
title: Five mistakes
roi: {x: 0, y: 0, width: 16, height: 16}
pulses: 0
measurements:
  - name: curve
    stimulus: {kind: reset_test, polarity: up, reset_s: 0.1, test_s: 100 ms,
               reset_contrast: {scale: linear, value: 0.5}}
    sweep:
      iluminance_lux: [1, 10]
      contrast: {scale: linear, values: [0.1, -0.2]}
"""


def lines_of(text: str, model: type[BaseModel]) -> list[str]:
    with pytest.raises(InputError) as caught:
        parse_model(text, model, "f.yaml")
    return [str(p) for p in caught.value.problems]


def test_five_mistakes_are_five_lines(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(FIVE_MISTAKES)
    with pytest.raises(InputError) as caught:
        load_protocol(path)
    assert str(caught.value).splitlines() == [
        f"{path}:4:9: pulses: 0 is out of range, must be at least 1",
        f"{path}:7:44: measurements[0].stimulus.polarity: 'up' is not one of on, off",
        f"{path}:7:70: measurements[0].stimulus.test_s: '100 ms' is not a number",
        f"{path}:10:7: measurements[0].sweep.iluminance_lux: unknown key, did you mean 'illuminance_lux'?",
        f"{path}:11:47: measurements[0].sweep.contrast.values[1]: -0.2 is out of range, must be above 0",
    ]


class Cat(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kind: Literal["cat"]
    lives: Annotated[int, Field(strict=True, ge=1, le=9)] = 9


class Dog(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kind: Literal["dog"]
    tricks: list[str] = []


class Home(BaseModel):
    model_config = ConfigDict(extra="forbid")
    pets: dict[str, Annotated[Cat | Dog, Field(discriminator="kind")]] = {}
    rooms: int | list[float] = 1
    owner: Cat | None = None
    heated: bool = False
    colour: str = Field(default="red", alias="paint", min_length=1)


def test_any_model_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "home.yaml"
    path.write_text("\ufeffpets: {tom: {kind: cat, lives: 3}}\nrooms: [1, 2.5]\n", encoding="utf-8")
    home = read_model(path, Home)
    assert home.pets["tom"] == Cat(kind="cat", lives=3)
    assert home.rooms == [1.0, 2.5]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("pets: {rex: {kind: dog, trick: [sit]}}", "1:25: pets.rex.trick: unknown key, did you mean 'tricks'?"),
        ("pets: {rex: {kind: dogg}}", "1:20: pets.rex.kind: 'dogg' is not one of cat, dog, did you mean 'dog'?"),
        ("pets: {rex: {tricks: []}}", "1:13: pets.rex: key 'kind' is missing"),
        ("pets: {tom: {kind: cat, lives: 10}}", "1:32: pets.tom.lives: 10 is out of range, must be at most 9"),
        ("pets: {tom: {kind: cat, lives: true}}", "1:32: pets.tom.lives: true is not a whole number"),
        ("pets: 5", "1:7: pets: 5 is not a mapping (key: value)"),
        ("rooms: many", "1:8: rooms: 'many' is not a whole number or 'many' is not a list"),
        ("owner: {kind: cat, live: 1}", "1:20: owner.live: unknown key, did you mean 'lives'?"),
        ("owner: {}", "1:8: owner: key 'kind' is missing"),
        ("heated: maybe", "1:9: heated: 'maybe' is not true or false"),
        ("paint: 5", "1:8: paint: 5 is not text"),
        ("paint: ''", "1:8: paint: must not be empty"),
        ("pant: blue", "1:1: pant: unknown key, did you mean 'paint'?"),
        ("zzz: 1", "1:1: zzz: unknown key, known here: pets, rooms, owner, heated, paint"),
        ("[1, 2]", "1:1: a list is not a mapping (key: value)"),
    ],
)
def test_problems_in_plain_words(text: str, line: str) -> None:
    assert lines_of(text, Home) == [f"f.yaml:{line}"]


def test_problems_come_in_the_order_of_the_file() -> None:
    text = "zzz: 1\nheated: 7\npets:\n  a: {kind: cat, lives: 0}\nrooms: x\n"
    assert [line.split(":")[1] for line in lines_of(text, Home)] == ["1", "2", "4", "5"]


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read: No such file"):
        read_model(tmp_path / "none.yaml", Home)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_text(tmp_path)


def test_bytes_that_are_no_text_have_a_place(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(b"a: 1\nb: \xff\n")
    with pytest.raises(InputError, match=r"f\.yaml:2:4: is not UTF-8 text"):
        read_text(path)


def test_a_path_with_a_zero_byte_is_one_line() -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_text("a\0b")
