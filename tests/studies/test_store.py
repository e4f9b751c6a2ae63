"""What all studies share: the resumable store, the fingerprint of code, tables as text."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from swim_agents.tables import markdown_table, text_table

from studies.fingerprint import code_of, files_digest, kernel_digest, text_digest, with_imports
from studies.store import Store
from swim_env.errors import SwimError
from tests.stability.test_interrupts import files_of_at_most


def opened(folder: Path) -> Store:
    return Store(folder / "found" / "results.jsonl", lambda record: record["name"])


# ---- the store ---------------------------------------------------------------------------------


def test_what_is_added_is_there_at_the_next_start(tmp_path):
    store = opened(tmp_path)
    assert store.records == [] and store.get("a") is None
    store.add({"name": "a", "value": 0.1})
    store.add({"name": "b", "arrays": True}, {"square": np.arange(3.0)})
    again = opened(tmp_path)
    assert again.records == store.records == [{"name": "a", "value": 0.1}, again.get("b")]
    assert again.arrays("b")["square"].tolist() == [0.0, 1.0, 2.0]
    assert sorted(path.name for path in store.path.parent.iterdir()) == ["b.npz", "results.jsonl"]


def test_the_last_record_of_a_name_counts_and_others_leave_when_tidied(tmp_path):
    store = opened(tmp_path)
    for name, value in (("a", 1), ("b", 2), ("a", 3)):
        store.add({"name": name, "value": value})
    again = opened(tmp_path)
    assert [one["value"] for one in again.records] == [3, 2]
    assert store.path.read_bytes().count(b"\n") == 3
    again.tidy()
    assert store.path.read_bytes().count(b"\n") == 2
    assert opened(tmp_path).records == again.records


def test_a_line_that_was_cut_off_is_done_anew(tmp_path):
    """Wherever a kill has come between."""
    store = opened(tmp_path)
    store.add({"name": "a", "value": 1})
    first = store.path.read_bytes()
    store.add({"name": "b", "value": 2})
    whole = store.path.read_bytes()
    for end in range(len(first), len(whole)):
        store.path.write_bytes(whole[:end])
        again = opened(tmp_path)
        assert again.get("a") == {"name": "a", "value": 1} and again.get("b") is None
        # Looking changes nothing.
        assert store.path.read_bytes() == whole[:end]
        again.add({"name": "b", "value": 2})
        assert store.path.read_bytes() == whole


@pytest.mark.parametrize("text", ["dear diary\n", '{"value": 1}\n', "[1]\n", '{"name": "a"\n{}\n'])
def test_a_file_of_anything_else_is_left_alone(text, tmp_path):
    path = tmp_path / "found" / "results.jsonl"
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SwimError, match="not the results of a study") as caught:
        opened(tmp_path)
    assert f"{path}, line 1" in str(caught.value)
    assert path.read_text(encoding="utf-8") == text


def test_what_cannot_be_written_leaves_the_file_as_it_was(tmp_path):
    store = opened(tmp_path)
    store.add({"name": "a"})
    before = store.path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        store.add({"name": "b", "value": float("nan")})
    # A disk with room for half a line.
    with files_of_at_most(len(before) + 5), pytest.raises(SwimError, match="too large") as caught:
        store.add({"name": "b"})
    assert str(store.path) in str(caught.value)
    assert store.path.read_bytes() == before and store.get("b") is None


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "no archive", "gone"])
def test_broken_arrays_count_as_missing(tmp_path, damage):
    store = opened(tmp_path)
    record = {"name": "a", "arrays": True}
    store.add(record, {"square": np.arange(3.0)})
    file = store.path.with_name("a.npz")
    whole = file.read_bytes()
    if damage == "gone":
        file.unlink()
    else:
        # Behind the first member's header, in what is compressed.
        flipped = whole[:90] + bytes([whole[90] ^ 0xFF]) + whole[91:]
        broken = {"cut": whole[:-30], "flipped": flipped, "empty": b"", "no archive": b"x" * 400}
        file.write_bytes(broken[damage])
    assert store.get("a") is None
    store.add(record, {"square": np.arange(3.0)})
    assert store.get("a") == record


# ---- fingerprints ------------------------------------------------------------------------------


def test_comments_and_docstrings_do_not_count_but_code_does():
    plain = 'def f(x):\n    """Say."""\n    # why\n    return x + 1\n'
    other = 'def f(x):\n    """Say it in other words."""\n    return x+1  # else\n'
    assert code_of(plain) == code_of(other)
    assert code_of(plain) != code_of(plain.replace("+ 1", "+ 2"))
    assert code_of('class A:\n    """Only words."""\n') == code_of("class A:\n    pass\n")
    assert text_digest("ab") == text_digest("a", "b") != text_digest("ba")


def test_kernels_count_at_any_depth_and_so_does_the_batch(tmp_path):
    changed = {}
    (tmp_path / "swim_env" / "sim").mkdir(parents=True)
    for name in ("batch.py", "constants.py"):
        (tmp_path / "swim_env" / "sim" / name).write_text("A = 0\n", encoding="utf-8")
    for place in (
        *("swim_env/sim/batch.py", "swim_env/sim/constants.py", "swim_env/physics/step.py"),
        *("swim_env/physics/planar/deep/law.py", "swim_env/physics/loading.py"),
        "swim_env/sim/simulator.py",
    ):
        file = tmp_path / place
        file.parent.mkdir(parents=True, exist_ok=True)
        found = set()
        for text in ("A = 1\n", "A = 2\n"):
            file.write_text(text, encoding="utf-8")
            kernel_digest.cache_clear()
            found.add(kernel_digest(tmp_path))
        changed[file.name] = len(found) == 2
    kernel_digest.cache_clear()
    kernels = {"batch.py": True, "constants.py": True, "step.py": True, "law.py": True}
    assert changed == {**kernels, "loading.py": False, "simulator.py": False}


def test_the_place_of_a_file_counts_and_where_the_checkout_is_does_not(tmp_path):
    found = []
    for place in ("one/a/b.py", "other/a/b.py", "one/c/b.py"):
        file = tmp_path / place
        file.parent.mkdir(parents=True)
        file.write_text("A = 1\n", encoding="utf-8")
        found.append(files_digest([file], tmp_path / place.split("/")[0]))
    assert found[0] == found[1] != found[2]


def test_imports_are_followed_in_all_their_forms(tmp_path):
    sources = {
        "a/start.py": "from a.one import x\nimport a.two\nfrom a import three\nimport b.away\n",
        "a/one.py": "from a.four import y\nfrom a.left import z\n",
        "a/two.py": "import a.start\n",
        **dict.fromkeys(("a/three.py", "a/four.py", "a/left.py", "a/alone.py", "b/away.py"), ""),
    }
    for place, text in sources.items():
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text(text, encoding="utf-8")
    found = with_imports("a.start", ("a",), ("a.left",), tmp_path)
    assert {path.stem for path in found} == {"start", "one", "two", "three", "four"}


# ---- tables ------------------------------------------------------------------------------------

ROWS: list[list[Any]] = [["one", 1, None], ["a|b", 22, "x"]]


def test_tables_in_markdown_and_for_a_terminal():
    assert markdown_table(["n", "", "c"], ROWS) == (
        "| n |  | c |\n|---|---|---|\n| one | 1 |  |\n| a\\|b | 22 | x |"
    )
    assert markdown_table(["n", "", "c"], ROWS, padded=True) == (
        "| n    |     |   c |\n| ---- | --: | --: |\n| one  |   1 |     |\n| a\\|b |  22 |   x |"
    )
    assert text_table(ROWS, left=True) == "one  1\na|b  22  x"
    assert text_table([["n", "m", "c"], *ROWS]) == "n     m  c\none   1\na|b  22  x"
    with pytest.raises(ValueError, match="a row of 1 cells in a table of 2"):
        markdown_table(["a", "b"], [["c"]])
