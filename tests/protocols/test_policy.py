"""The section `policy`: left out it is what a run always did, and mistakes are found with their place."""

from __future__ import annotations

import pytest

from protocols import InputError, library, parse_protocol
from protocols.policy import Policy
from protocols.schema import Protocol

TEXT = library.text("quick_look")


def _with(*lines: str) -> str:
    return TEXT.replace("measurements:\n", "".join(f"{line}\n" for line in lines) + "measurements:\n", 1)


def test_left_out_nothing_is_tried_again_and_the_first_failure_ends_the_run() -> None:
    policy = parse_protocol(TEXT, "x.yaml").protocol.policy
    assert policy == Policy()
    assert (policy.on_failure.retries, policy.on_failure.then) == (0, "abort")
    assert (policy.on_bad_point.retries, policy.on_bad_point.then) == (0, "keep")
    assert policy.deadline is None


def test_it_is_spelled_out_where_the_protocol_is_and_does_not_change_the_points() -> None:
    asked = _with(
        "policy: {on_failure: {retries: 3, then: skip}, deadline: {factor: 2}}", "suspend: {check_every_s: 5}"
    )
    protocol = parse_protocol(asked, "x.yaml").protocol
    resolved = protocol.resolved()
    assert resolved["policy"]["on_failure"] == {"retries": 3, "wait_s": 5.0, "then": "skip"}
    assert resolved["policy"]["deadline"] == {"factor": 2.0, "at_least_s": 120.0}
    assert resolved["suspend"]["check_every_s"] == 5.0
    again = Protocol.model_validate(resolved)
    assert (again.policy, again.suspend) == (protocol.policy, protocol.suspend)
    assert again.expand() == protocol.expand() == parse_protocol(TEXT, "x.yaml").protocol.expand()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("policy: {on_failure: {retry: 1}}", r"policy.on_failure.retry: unknown key, did you mean 'retries'?"),
        ("policy: {on_failure: {then: stop}}", "'stop' is not one of skip, pause, abort"),
        ("policy: {on_failure: {retries: -1}}", "-1 is out of range, must be at least 0"),
        ("policy: {deadline: {factor: 0.5}}", "0.5 is out of range, must be at least 1"),
        ("policy: {reconnect: {attempts: true}}", "true is not a whole number"),
    ],
)
def test_mistakes_are_found_with_their_place(line: str, message: str) -> None:
    text = _with(line)
    number = text.splitlines().index(line) + 1
    with pytest.raises(InputError) as caught:
        parse_protocol(text, "x.yaml")
    (problem,) = caught.value.problems
    assert str(problem).startswith(f"x.yaml:{number}:")
    assert message in str(problem)
