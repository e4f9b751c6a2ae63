"""The benchmark's report: tables for people, and the folder that keeps everything."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from swim_agents.tables import markdown_table

from studies.benchmark.picture import draw_benchmark
from studies.benchmark.startup import PHASES
from swim_env.files.folders import write_folder
from swim_env.plots import save_figure

#: What a folder of results holds.
REPORT_FILES = ("benchmark.json", "benchmark.md", "benchmark.png")

Record = Mapping[str, Any]
#: The columns of a table: what each shows of a row.
Columns = Mapping[str, Callable[[Any], str]]

#: The workload that chains and rods of other packages are compared with.
_OURS = "paper_i_rollout"


def report_tables(record: Record) -> str:
    """Return what `scripts/benchmark.py` ends with as tables in Markdown, without absent sections.

    They read well as plain text.
    """
    speeds, ratios = record.get("speeds", {}), record.get("ratios", {})
    coarse = [speed for speed in speeds.values() if "deviation" in speed]
    growth, stable = "Growth of a step's time with the number of elements N", "Largest stable steps"
    sections = [
        *_kernel_tables(record.get("kernel", [])),
        _table(growth, _GROWTH, record.get("growth", [])),
        _table("What effects cost", _EFFECTS, record.get("effects", [])),
        _table("Environment steps", _SPEEDS, speeds.values()),
        _table(f"{stable}, which need not be accurate", _STABLE_STEPS, coarse),
        _ahead_and_behind(speeds),
        _table("Beside the peers", _RATIOS, ratios.values()),
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
    """Write data, page and picture into a folder, all of them or none; see `write_folder`."""

    def write(ready: Path) -> None:
        data = json.dumps(record, indent=1, allow_nan=False) + "\n"
        (ready / "benchmark.json").write_text(data, encoding="utf-8")
        (ready / "benchmark.md").write_text(report_page(record), encoding="utf-8")
        save_figure(draw_benchmark(record), ready / "benchmark.png")

    write_folder(folder, REPORT_FILES, write)


# ---- tables ------------------------------------------------------------------------------------


def _table(title: str, columns: Columns, items: Iterable[Any]) -> str:
    """Return a table under its heading, nothing without rows."""
    rows = [[show(item) for show in columns.values()] for item in items]
    return f"## {title}\n\n{markdown_table(list(columns), rows, padded=True)}" if rows else ""


def _number(value: float) -> str:
    """Return a number with three digits, or all before the point."""
    return f"{value:,.0f}" if 100.0 <= abs(value) < 1e7 else f"{value:.3g}"


def _percent(value: float, digits: int = 0) -> str:
    return f"{100 * value:.{digits}f} %"


def _median(spread: Record | None) -> str:
    return "" if spread is None else _number(spread["median"])


def _spread(name: str) -> Callable[[Record], str]:
    """Return a column of medians with quartiles, or of plain numbers."""

    def show(row: Record) -> str:
        value = row[name]
        if not isinstance(value, Mapping):
            return _number(value)
        return f"{_median(value)} ({_number(value['low'])} to {_number(value['high'])})"

    return show


def _met(row: Record) -> str:
    return "yes" if row["met"] else "no"


_GROWTH: Columns = {
    "fluid model": lambda fit: (
        f"{fit['fluid_model']}, {fit['panels_per_element']} panels per element"
    ),
    "N": lambda fit: f"{fit['elements_from']} to {fit['elements_to']}",
    "exponent": lambda fit: f"{fit['exponent']:.2f}",
    "largest deviation": lambda fit: _percent(fit["largest_deviation"]),
}
_EFFECTS: Columns = {
    "effect": lambda one: str(one["effect"]),
    "with (us a step)": _spread("with"),
    "without (us a step)": _spread("without"),
    "added (us)": _spread("added"),
    "without / with": _spread("removed"),
}
_SPEEDS: Columns = {
    "environment": lambda one: str(one["label"]),
    "steps per second": _spread("steps_per_second"),
    "us per step": _spread("microseconds_per_step"),
    "simulated s per s": _spread("simulated_seconds_per_second"),
}
_STABLE_STEPS: Columns = {
    "peer": lambda speed: str(speed["label"]),
    "step (ms)": lambda speed: _number(1e3 * speed["time_step"]),
    "deviation from a quarter of the step": lambda speed: _percent(speed["deviation"]),
}
_RATIOS: Columns = {
    "steps per second, compared": lambda one: str(one["label"]),
    "ratio": _spread("ratio"),
    "aim": lambda one: f"\u2265 {one['aim']:g}",
    "met": _met,
}


def _kernel_tables(cells: Sequence[Record]) -> list[str]:
    """Return a table for every fluid model: a row for every beam."""
    tables = []
    for model in dict.fromkeys(cell["fluid_model"] for cell in cells):
        some = [cell for cell in cells if cell["fluid_model"] == model]
        rows = [
            {
                "N x panels per element": f"{cell['elements']} x {cell['panels_per_element']}",
                "step": _spread("step")(cell),
                **{part: _median(cell["parts"].get(part)) for one in some for part in one["parts"]},
                "floor": _median(cell.get("floor")),
                "step / floor": _median(cell.get("step_to_floor")),
            }
            for cell in some
        ]
        columns = {head: itemgetter(head) for head in rows[0]}
        tables.append(_table(f"Microseconds of a physics step, fluid model {model}", columns, rows))
    return tables


def _ahead_and_behind(speeds: Record) -> str:
    """Say which peers are ahead of this package and which are behind, on the same beam."""
    ours = speeds.get(_OURS)
    peers = [speeds[name] for name in speeds if name.startswith(("mujoco_chain", "elastica_rod"))]
    if ours is None or not peers:
        return ""

    def simulated(speed: Record) -> float:
        return float(speed["simulated_seconds_per_second"]["median"])

    def physics_steps(speed: Record) -> float:
        return float(speed["steps_per_second"]["median"] * speed["physics_steps_per_step"])

    lines: dict[bool, list[str]] = {True: [], False: []}
    for peer in sorted(peers, key=simulated, reverse=True):
        times = f"- {_number(simulated(peer) / simulated(ours))} times: {peer['label']}"
        lines[simulated(peer) > simulated(ours)].append(times)
    ahead, behind = ("\n".join(lines[which] or ["- none"]) for which in (True, False))
    fastest = max(peers, key=physics_steps)
    return (
        f"## Who is ahead, in simulated seconds per wall second on the same beam\n\n"
        f"{ours['label']}: {_number(simulated(ours))} simulated seconds per second. No peer "
        f"computes the added mass of\nthe surrounding flow. Ahead of this package:\n\n"
        f"{ahead}\n\nBehind it:\n\n{behind}\n\n"
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
    columns: Columns = {"of": itemgetter(0), "MB": lambda row: _number(row[1] / 1e6)}
    return _table(title, columns, sizes.items())


def _startup_table(startup: Record | None) -> str:
    if startup is None:
        return ""
    warm, cold = startup["warm"], startup.get("cold")
    columns: Columns = {
        "start-up (s)": lambda start: "kernels in the cache" if start is warm else "empty cache",
        **{phase.replace("_", " "): _spread(phase) for phase in PHASES if phase in warm},
        "aim of total": lambda start: f"< {start['aim']:g}",
        "met": _met,
    }
    starts = [warm] if cold is None else [warm, cold]
    text = _table("Start-up: import, make and first step", columns, starts)
    if cold is not None and cold["announcement"]:
        said = "\n".join(f"    {line}" for line in cold["announcement"])
        text += f"\n\nSaid on stderr, first after {cold['announced_after']:.1f} s:\n\n{said}"
    return text


def _training_table(training: Record) -> str:
    runs = [run for run in training.values() if run]
    rows = [
        {
            "training": f"{run['algorithm']}, {run['members']} members, "
            f"{run['environment_threads']} threads, PyTorch {run['torch_threads']}",
            "steps per second": _spread("steps_per_second")(run),
            **{part: _percent(share, 1) for part, share in run["shares"].items()},
        }
        for run in runs
    ]
    columns = {head: itemgetter(head) for row in rows for head in row}
    return _table("Where training spends its time", columns, rows)
