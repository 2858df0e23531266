"""Names are plain words, and text from outside steers no terminal."""

from __future__ import annotations

import numpy as np
import pytest

from cases.trial import Trial
from mmg.errors import LONGEST_NAME, BadValue, TargetExists, UserError, check_name, name_fault
from mmg.messages import Message
from mmg.ship import Ship
from tests.architecture.source import ROOT

PATHS = (
    "../../evil", "/etc/evil", "a/b", "a\\b", "C:evil", "..", ".", "evil\n", "\x1b[2Jevil", "\u202eevil",
    "é" * LONGEST_NAME,
)  # fmt: skip


@pytest.mark.parametrize("name", PATHS)
def test_what_is_no_plain_word_names_nothing(name: str) -> None:
    assert name_fault(name)
    with pytest.raises(BadValue, match="name = '"):
        check_name(name, "trial")
    with pytest.raises(UserError):
        Trial(name, {"t": np.arange(2.0)})
    with pytest.raises(UserError):
        Ship(name, {}, {}, {})


@pytest.mark.parametrize("name", ["run 7", "cost_$1_$2", "zigzag 20-20, second", "Überführung", "a.b", "10:30", "船"])
def test_plain_words_are_names(name: str) -> None:
    check_name(name, "trial")
    assert Trial(name, {"t": np.arange(2.0)}).name == name


def test_escape_sequences_are_shown() -> None:
    assert str(UserError("column '\x1b[2J\x07\x9b'")) == r"column '\x1b[2J\x07\x9b'"
    assert Message("not used: \x1b]0;x\x07", "columns_ignored") == r"not used: \x1b]0;x\x07"
    assert str(UserError("plain: äöü\nnext")) == r"plain: äöü\nnext"


def test_the_code_of_an_error_is_the_kind_of_its_fault() -> None:
    assert (UserError().code, BadValue().code, TargetExists().code) == ("user_error", "bad_value", "target_exists")
    page = (ROOT / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
    kinds = [kind for kind in UserError.__subclasses__() if kind.__module__ == UserError.__module__]
    assert len(kinds) > 10 and [kind for kind in kinds if f"`{kind().code}`" not in page] == []
