"""The README and the pages: what they show works, and what they say is what was measured."""

import argparse
import importlib
import json
import re
import shlex
from pathlib import Path
from statistics import median

import pytest
from swim_agents.commands.main import COMMANDS
from swim_agents.policies import PRETRAINED_FOLDER, pretrained_names

import swim_env
from tests.support import ROOT, run_python

README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not {"_generated", "api"} & set(page.parts)]


def name_of(page: Path) -> str:
    """Return a page's place in the repository."""
    return page.relative_to(ROOT).as_posix()


def fenced(text: str, language: str) -> list[str]:
    """Return the blocks of code of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def commands_of(page: Path) -> list[str]:
    """Return the lines of shell that call the console command."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for block in fenced(text, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith("swim-env ")]


def test_the_readme_is_short():
    assert len(README.split()) < 900


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "docs/start.md"], ids=name_of)
def test_the_first_episode_is_ten_lines_that_run(page):
    (code,) = fenced(page.read_text(encoding="utf-8"), "python")
    assert len(code.strip().splitlines()) <= 11  # one of them is empty
    done = run_python("-c", code)
    assert re.fullmatch(r"-?0\.\d{3} body lengths in 20 s\n", done.out), done.err


@pytest.mark.parametrize("page", [page for page in PAGES if commands_of(page)], ids=name_of)
def test_the_commands_of_the_pages_are_understood(page):
    for line in commands_of(page):
        _, name, *arguments = shlex.split(line, comments=True)
        assert name in COMMANDS, line
        module = importlib.import_module(f"swim_agents.commands.{name.replace('-', '_')}")
        parser = argparse.ArgumentParser(exit_on_error=False)
        module.add_arguments(parser)
        parser.parse_args(arguments)


def test_the_targets_of_make_that_pages_name_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        named = [*re.findall(r"`make ([a-z-]+)", text)]
        named += re.findall(r"^make ([a-z-]+)", "".join(fenced(text, "sh")), re.MULTILINE)
        assert set(named) <= targets, name_of(page)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_between_files_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if not re.match(r"[a-z]+:", link):
            target, _, anchor = link.partition("#")
            file = page.parent / target if target else page
            assert file.exists(), link
            assert not anchor or anchor in anchors(file), link


def anchors(page: Path) -> set[str]:
    """Return the names of a page's headings in links."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_the_readme_quotes_the_stored_comparison():
    stored = json.loads((ROOT / "docs/comparison/comparison.json").read_text(encoding="utf-8"))
    quoted = ("paper_wave", "tuned_wave", "ppo_forward", "sac_forward", "optimal_displacement")
    for name in quoted:
        policy = stored["policies"][name]
        (row,) = re.findall(rf"^\| `{name}`.*$", README, re.MULTILINE)
        figures = [median(policy["net_displacement"]), median(policy["closed_displacement"])]
        figures.append(stored["ratios"][name]["tuned_wave"])
        assert [cell.strip() for cell in row.split("|")[2:5]] == [f"{one:.2f}" for one in figures]


def figures_of(name: str) -> set[str]:
    """Return how far a policy swims (BL), as it was computed and finer, as pages may say it."""
    stored = json.loads((ROOT / "docs/comparison/comparison.json").read_text(encoding="utf-8"))
    file = PRETRAINED_FOLDER / name / "scores.json"
    if name in stored["policies"]:
        record = stored["policies"][name]
    else:
        record = json.loads(file.read_text(encoding="utf-8"))
    kinds = ("net_displacement", "closed_displacement")
    return {f"{median(record[kind]):.2f}" for kind in kinds}


def lines_and_heads(page: Path) -> list[tuple[str, str]]:
    """Return a page's lines, those of tables with their table's first line, others with none."""
    head, pairs = "", []
    for line in page.read_text(encoding="utf-8").splitlines():
        head = (head or line) if line.startswith("|") else ""
        pairs.append((line, head))
    return pairs


#: Its figures are of runs on the way and of all seeds.
TRIED = ROOT / "docs/reports/training.md"


@pytest.mark.parametrize("page", [page for page in PAGES if page != TRIED], ids=name_of)
def test_a_page_states_the_stored_figure_for_a_policy(page):
    """Body lengths in a line, or in a row of a table in them, that names one policy."""
    names = {*pretrained_names(), "paper_wave", "tuned_wave"}
    for line, head in lines_and_heads(page):
        named = names & set(re.findall(r"`(\w+)`", line))
        said = re.findall(r"(\d+\.\d+) BL\b(?!/)", line)
        if "(BL)" in head:
            cells = zip(head.split("|"), line.split("|"), strict=True)
            said += [cell.strip() for title, cell in cells if "(BL)" in title]
        if len(named) == 1:
            assert set(said) <= figures_of(named.pop()), line


def test_the_report_on_training_starts_from_the_stored_waves():
    text = TRIED.read_text(encoding="utf-8")
    plane, eel, fish = (
        json.loads((ROOT / f"agents/swim_agents/{name}tuned_wave.json").read_text("utf-8"))
        for name in ("", "eel_3d.", "fish_3d.")
    )
    reached = f"{plane['net_displacement']:.2f}"
    assert f"tuned wave reaches {reached} BL in 20 s" in text
    assert reached in figures_of("tuned_wave")
    in_space = f"{eel['net_displacement']:.2f} BL\nwith the eel and {fish['net_displacement']:.2f}"
    assert f"tuned lateral wave reaches {in_space} with the fish" in text


@pytest.mark.parametrize("name", ["ppo_forward", "sac_forward"])
def test_an_agents_own_record_has_the_starts_of_the_comparison(name):
    stored = json.loads((ROOT / "docs/comparison/comparison.json").read_text(encoding="utf-8"))
    own = json.loads((PRETRAINED_FOLDER / name / "scores.json").read_text(encoding="utf-8"))
    count = len(stored["seeds"])
    assert own["seeds"][:count] == stored["seeds"]
    for kind in ("net_displacement", "closed_displacement"):
        assert own[kind][:count] == stored["policies"][name][kind]


def test_every_reason_to_end_is_explained():
    page = (ROOT / "docs/help/ends.md").read_text(encoding="utf-8")
    for reason in swim_env.TERMINATION_REASONS:
        assert re.search(rf"^## {reason}\b", page, re.MULTILINE), reason
