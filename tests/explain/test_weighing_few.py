"""What a few runs are made of is looked for first."""

from pathlib import Path

from sealed_sessions import drawn

from schwung.explain.weighing.published import publish


def test_three_causes_at_once(tmp_path: Path) -> None:
    """From nothing, all runs led to curves over position, speed and time, and no name."""
    session, machine, label = drawn(tmp_path, 294501, 2, kind="three", level="clear")
    found = publish(session, machine)
    hidden = {effect["physics"] for effect in label["effects"]}
    assert hidden == {"stribeck_friction", "cogging", "load_event"}
    assert {one.physics for one in found.names if one.probability > 0.9} == hidden
    assert not [one for one in found.curves if one.probability > 0.5]
