"""The benchmark's report: tables for people, and the folder that keeps everything."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from studies.benchmark.picture import draw_benchmark
from studies.benchmark.startup import PHASES
from swim_env.files.folders import write_folder
from swim_env.files.tables import markdown_table
from swim_env.plots import save_figure

__all__ = ["REPORT_FILES", "report_page", "report_tables", "write_report"]

#: What a folder of results holds.
REPORT_FILES = ("benchmark.json", "benchmark.md", "benchmark.png")

Record = Mapping[str, Any]

#: The workload that chains and rods of other packages are compared with.
_OURS = "paper_i_rollout"


def report_tables(record: Record) -> str:
    """Return what `scripts/benchmark.py` ends with as tables in Markdown, without absent sections.

    They read well as plain text.
    """
    speeds, ratios = record.get("speeds", {}), record.get("ratios", {})
    sections = [
        *_kernel_tables(record.get("kernel", [])),
        _growth_table(record.get("growth", [])),
        _effects_table(record.get("effects", [])),
        _speed_table(speeds),
        _stable_step_table(speeds),
        _ahead_and_behind(speeds),
        _ratio_table(ratios),
        _memory_table(record.get("memory")),
        _startup_table(record.get("startup")),
        _training_table(record.get("training", {})),
    ]
    missing = [f"- {name}: {reason}" for name, reason in record.get("skipped", {}).items()]
    if missing:
        sections.append("## Not measured\n\n" + "\n".join(missing))
    return "\n\n".join(filter(None, sections))


def report_page(record: Record) -> str:
    """Return the page beside the data: where, when and how, picture and tables."""
    machine = record["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in record["versions"].items())
    where = (
        f"`{record['command']}` on {record['date']}, commit {record['commit'] or 'unknown'}\n"
        f"(a + behind it: with changes), on {machine['processor']}, {machine['cores']} cores,\n"
        f"{machine['system']}; {versions}. It took {record['wall_seconds']:.0f} s."
    )
    how = (
        "Medians, with the quartiles in brackets, of repeated measurements. What is compared was\n"
        "timed in turn, round after round, and ratios are those of the times of one round."
    )
    picture = "![Time of a physics step, its parts, and speed beside the peers](benchmark.png)"
    tables = report_tables(record)
    return f"# Benchmark\n\n{where}\n\n{how}\n\n{picture}\n\n{tables}\n"


def write_report(record: Record, folder: str | os.PathLike[str]) -> None:
    """Write data, page and picture into a folder, all of them or none.

    Raises
    ------
    SwimError
        If the folder holds other files or cannot be written, or matplotlib is not installed.
    """

    def write(ready: Path) -> None:
        data = json.dumps(record, indent=1, allow_nan=False) + "\n"
        (ready / "benchmark.json").write_text(data, encoding="utf-8")
        (ready / "benchmark.md").write_text(report_page(record), encoding="utf-8")
        save_figure(draw_benchmark(record), ready / "benchmark.png")

    write_folder(folder, REPORT_FILES, write)


# ---- tables ------------------------------------------------------------------------------------


def _table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table under its heading, nothing without rows."""
    rows = list(rows)
    return f"## {title}\n\n{markdown_table(heads, rows, padded=True)}" if rows else ""


def _number(value: float) -> str:
    """Return a number with three digits, or all before the point."""
    return f"{value:,.0f}" if 100.0 <= abs(value) < 1e7 else f"{value:.3g}"


def _spread(spread: Record) -> str:
    low, high = _number(spread["low"]), _number(spread["high"])
    return f"{_number(spread['median'])} ({low} to {high})"


def _median(spread: Record | None) -> str:
    return "" if spread is None else _number(spread["median"])


def _aim(measured: Record, sign: str) -> tuple[str, str]:
    """Return the aim and whether it was met."""
    return f"{sign} {measured['aim']:g}", "yes" if measured["met"] else "no"


def _kernel_tables(cells: Sequence[Record]) -> list[str]:
    """Return a table for every fluid model: a row for every beam."""
    tables = []
    for model in dict.fromkeys(cell["fluid_model"] for cell in cells):
        some = [cell for cell in cells if cell["fluid_model"] == model]
        parts = list(dict.fromkeys(part for cell in some for part in cell["parts"]))
        rows = [
            [
                f"{cell['elements']} x {cell['panels_per_element']}",
                _spread(cell["step"]),
                *(_median(cell["parts"].get(part)) for part in parts),
                _median(cell.get("floor")),
                _median(cell.get("step_to_floor")),
            ]
            for cell in some
        ]
        heads = ["N x panels per element", "step", *parts, "floor", "step / floor"]
        tables.append(_table(f"Microseconds of a physics step, fluid model {model}", heads, rows))
    return tables


def _growth_table(fits: Sequence[Record]) -> str:
    rows = [
        [
            f"{fit['fluid_model']}, {fit['panels_per_element']} panels per element",
            f"{fit['elements_from']} to {fit['elements_to']}",
            f"{fit['exponent']:.2f}",
            f"{100 * fit['largest_deviation']:.0f} %",
        ]
        for fit in fits
    ]
    heads = ["fluid model", "N", "exponent", "largest deviation"]
    return _table("Growth of a step's time with the number of elements N", heads, rows)


def _effects_table(effects: Sequence[Record]) -> str:
    names = ("with", "without", "added", "removed")
    rows = [[one["effect"], *(_spread(one[name]) for name in names)] for one in effects]
    heads = ("effect", "with (us a step)", "without (us a step)", "added (us)", "without / with")
    return _table("What effects cost", heads, rows)


def _speed_table(speeds: Record) -> str:
    names = ("steps_per_second", "microseconds_per_step", "simulated_seconds_per_second")
    rows = [[one["label"], *(_spread(one[name]) for name in names)] for one in speeds.values()]
    heads = ["environment", "steps per second", "us per step", "simulated s per s"]
    return _table("Environment steps", heads, rows)


def _ratio_table(ratios: Record) -> str:
    rows = [[one["label"], _spread(one["ratio"]), *_aim(one, "\u2265")] for one in ratios.values()]
    heads = ["steps per second, compared", "ratio", "aim", "met"]
    return _table("Beside the peers", heads, rows)


def _stable_step_table(speeds: Record) -> str:
    """Return how large the largest stable steps of peers are, and how accurate a run with them."""
    rows = [
        [speed["label"], _number(1e3 * speed["time_step"]), f"{100 * speed['deviation']:.0f} %"]
        for speed in speeds.values()
        if "deviation" in speed
    ]
    heads = ["peer", "step (ms)", "deviation from a quarter of the step"]
    return _table("Largest stable steps, which need not be accurate", heads, rows)


def _ahead_and_behind(speeds: Record) -> str:
    """Say which peers are ahead of this package and which are behind, on the same beam."""
    ours = speeds.get(_OURS)
    peers = [
        speed for name, speed in speeds.items() if name.startswith(("mujoco_chain", "elastica_rod"))
    ]
    if ours is None or not peers:
        return ""

    def simulated(speed: Record) -> float:
        return float(speed["simulated_seconds_per_second"]["median"])

    def physics_steps(speed: Record) -> float:
        return float(speed["steps_per_second"]["median"] * speed["physics_steps_per_step"])

    def listed(ahead: bool) -> str:
        some = [one for one in peers if (simulated(one) > simulated(ours)) is ahead]
        ranked = sorted(some, key=simulated, reverse=True)
        lines = [
            f"- {_number(simulated(one) / simulated(ours))} times: {one['label']}" for one in ranked
        ]
        return "\n".join(lines) or "- none"

    fastest = max(peers, key=physics_steps)
    return (
        f"## Who is ahead, in simulated seconds per wall second on the same beam\n\n"
        f"{ours['label']}: {_number(simulated(ours))} simulated seconds per second. No peer "
        f"computes the added mass of\nthe surrounding flow. Ahead of this package:\n\n"
        f"{listed(True)}\n\nBehind it:\n\n{listed(False)}\n\n"
        f"In plain steps per second peers are ahead: {_number(physics_steps(fastest))} of "
        f"{fastest['label']},\n{_number(physics_steps(ours))} here."
    )


def _memory_table(memory: Record | None) -> str:
    if memory is None:
        return ""
    arrays, resident, many = memory["arrays"], memory["resident"], memory["many_elements"]
    sizes = {f"arrays of {members} members": size for members, size in arrays["bytes"].items()}
    sizes["each member more"] = arrays["bytes_per_member"]
    sizes[f"each of {many['elements']} elements"] = many["bytes_per_member"]
    if resident is not None:
        sizes["a process with one member"] = resident["process"]
        for members, size in resident["growth"].items():
            sizes[f"it grows by, {members} members more"] = size
    title = f"Memory, scene {memory['scene']} with {memory['elements']} elements"
    rows = [[name, _number(size / 1e6)] for name, size in sizes.items()]
    return _table(title, ["of", "MB"], rows)


def _startup_table(startup: Record | None) -> str:
    if startup is None:
        return ""
    warm, cold = startup["warm"], startup.get("cold")
    phases = [phase for phase in PHASES if phase in warm]
    rows = [["kernels in the cache", *(_spread(warm[phase]) for phase in phases), *_aim(warm, "<")]]
    if cold is not None:
        rows.append(["empty cache", *(_number(cold[phase]) for phase in phases), *_aim(cold, "<")])
    heads = ["start-up (s)", *(phase.replace("_", " ") for phase in phases), "aim of total", "met"]
    text = _table("Start-up: import, make and first step", heads, rows)
    if cold is not None and cold["announcement"]:
        said = "\n".join(f"    {line}" for line in cold["announcement"])
        text += f"\n\nSaid on stderr, first after {cold['announced_after']:.1f} s:\n\n{said}"
    return text


def _training_table(training: Record) -> str:
    runs = [run for run in training.values() if run]
    rows = [
        [
            f"{run['algorithm']}, {run['members']} members, {run['environment_threads']} threads, "
            f"PyTorch {run['torch_threads']}",
            _spread(run["steps_per_second"]),
            *(f"{100 * share:.1f} %" for share in run["shares"].values()),
        ]
        for run in runs
    ]
    parts = runs[0]["shares"] if runs else {}
    return _table("Where training spends its time", ["training", "steps per second", *parts], rows)
