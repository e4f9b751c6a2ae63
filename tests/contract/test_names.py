"""Names that users give: what files are called after them, and where they are shown."""

import re
import shlex

import pytest
from swim_agents.baselines import ZeroPolicy
from swim_agents.comparison.contest import Entry, entries_of, hold_contest
from swim_agents.policies import PRETRAINED_FOLDER, policy_label

from swim_env import OptionError, Scene, Simulator, load_scene
from swim_env.files.names import file_name, shown_name
from swim_env.plots import draw_path
from swim_env.recording import Swimmer, open_viewer, read_recording, write_recording
from swim_env.scene import scene_label
from tests.support import call_script, refuses

NAMES = (
    *("a_b", "a b", "a-b ", "../a_b", "/a_b", "..", "", "nul\0x", "\udcff", "CON."),
    *("\u9c7c", "\u9b5a", "a" * 300, "a" * 301),
)


def test_unlike_names_are_unlike_plain_parts_of_a_path():
    files = [file_name(name) for name in NAMES]
    files += [file_name("a_b", content) for content in ("x", "y")]
    assert files[0] == "a_b" and len({file.lower() for file in files}) == len(files)
    assert all(re.fullmatch(r"[\w-]{1,200}", file, re.ASCII) for file in files)
    assert [file_name(name) for name in files[:1] + files[-2:]] == files[:1] + files[-2:]
    assert shown_name("a\u9c7c b\x1b\udcff") == "a\u9c7c b\\x1b\\udcff"


def test_files_of_unlike_scenes_and_policies_are_unlike(tmp_path):
    """A shipped scene keeps its name for any duration; others of that name have another file."""
    swimmer = load_scene("swimmer")
    changes: list[dict[str, object]] = [
        {"beam.elements": 7}, {"beam.elements": 8}, {"name": "a b"}, {"name": "a_b"},
    ]  # fmt: skip
    labels = [scene_label(swimmer.replace(change)) for change in changes]
    assert scene_label(swimmer.replace("episode.duration", 1.0)) == "swimmer"
    assert len({"swimmer", *labels}) == 5 and labels[0].startswith("swimmer-")
    agents = [policy_label(str(tmp_path / run / "agent")) for run in "ab"]
    assert policy_label("ppo_forward") == "ppo_forward" and len(set(agents)) == 2


def test_the_name_in_a_scene_file_does_not_lead_a_video_elsewhere(tmp_path, capsys):
    pytest.importorskip("moviepy")
    scene = tmp_path / "a.yaml"
    load_scene("paper_iv").replace("name", "../escaped").save(scene)
    options = ("--duration", "0.1", "--env", "--policy", "zero", "--record-video")
    done = call_script(capsys, "replay", "--scene", scene, *options, tmp_path / "in" / "videos")
    assert done.code == 0, done.err
    (video,) = tmp_path.rglob("*.mp4")
    assert video.parent == tmp_path / "in" / "videos" and video.name.startswith("escaped-")


def test_any_name_is_drawn_and_recorded(tmp_path):
    """As it is, without formulas; what cannot be shown is escaped."""
    simulator = Simulator(load_scene("paper_iv").replace("name", r"$\frac$ \u9c7c"))
    run = simulator.rollout(simulator.prescribed_torques(5))
    figure = draw_path(run, name=r"$x$")
    assert r"\$x\$ on \$\frac\$" in figure.get_suptitle()
    file = tmp_path / "x.rrd"
    write_recording(file, [Swimmer("b\udcff", run), Swimmer("b\x1b", run)], flow_rate=None)
    assert list(read_recording(file).swimmers) == ["b", "b_2"]


def test_no_two_entries_of_a_contest_have_one_name(tmp_path):
    """Agents of one name get marks; entries that are given with one name are refused."""
    scene = load_scene("swimmer")
    entries = entries_of(["ppo_forward", str(PRETRAINED_FOLDER / "ppo_forward")], scene)
    assert [entry.name for entry in entries[2:]] == ["ppo_forward", "ppo_forward'"]
    twice = [*entries[:2], *[Entry("x", "x", ZeroPolicy(scene), {})] * 2]
    with refuses(OptionError, "entries must have different names"):
        hold_contest(scene, twice, [0])


def test_commands_to_type_are_quoted(tmp_path, capsys, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    file = tmp_path / "my run" / "a.rrd"
    options = ("--scene", "paper_iv", "--duration", "0.1", "--no-flow", "--output", file)
    done = call_script(capsys, "visualise", *options)
    command = re.search("look at it with: (.*)", done.err)
    assert command is not None and shlex.split(command[1])[1:] == [str(file)]
    assert f"rerun '{file}' (on" in str(open_viewer(file))


@pytest.mark.parametrize("text", ["a\x85b", "\x1b", "\0", "\udcff", "a\rb"])
def test_scenes_hold_only_what_their_files_keep(text):
    for field in ("name", "description"):
        with refuses(ValueError, f"{field} must be text", "printable"):
            Scene(**{field: f"x{text}"})
    kept = Scene(name=" \u9c7c #: '", description="a\tb\n\n c \u9c7c\n")
    assert Scene.from_dict(load_scene_text(kept)) == kept


def load_scene_text(scene: Scene) -> object:
    """Return a scene's fields through the text of its file."""
    from swim_env.scene.yaml import parse_yaml

    return parse_yaml(scene.to_yaml())
