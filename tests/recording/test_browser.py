"""Recordings in a browser and in a notebook: who can reach them, how they end, what is refused."""

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path
from urllib.parse import parse_qs, urlparse

import pytest

from swim_env import Simulator, SwimError
from swim_env.recording import Swimmer, show, web_viewer, write_recording
from tests.support import ENVIRONMENT

COMMAND = "import sys; from swim_agents.commands.main import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    """A recording of a tenth of a second."""
    simulator = Simulator("swimmer")
    run = simulator.rollout(simulator.prescribed_torques(10))
    path = tmp_path_factory.mktemp("recording") / "one.rrd"
    write_recording(path, [Swimmer("one", run)], flow_rate=None)
    return path


def data_port(address: str) -> int:
    """Return the port of the data, which the page is told in its address."""
    (source,) = parse_qs(urlparse(address).query)["url"]
    port = urlparse(source.removeprefix("rerun+")).port
    assert port is not None
    return port


def is_open(host: str, port: int) -> bool:
    with socket.socket() as one:
        one.settimeout(2.0)
        return one.connect_ex((host, port)) == 0


def test_page_and_data_are_there_for_this_machine_only_until_the_block_ends(file):
    with web_viewer(file, 0) as viewer:
        with urllib.request.urlopen(viewer.address, timeout=10) as answer:
            assert answer.status == 200 and b"Rerun Viewer" in answer.read()
        page, data = urlparse(viewer.address).port, data_port(viewer.address)
        for port in (page, data):
            assert is_open("127.0.0.1", port)
            # Another address of this machine: open only if the port is bound to all of them.
            if sys.platform == "linux":
                assert not is_open("127.0.0.2", port)
    assert not is_open("127.0.0.1", page) and not is_open("127.0.0.1", data)


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_the_command_says_where_and_ends_without_a_trace(file, name, code):
    """Told to end, it ends the server too; Ctrl-C in one line."""
    command = [sys.executable, "-c", COMMAND, "visualise", "--recording", str(file), "--web"]
    process = subprocess.Popen(
        [*command, "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
        # A shell may have left Ctrl-C ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    with process:
        assert process.stderr is not None
        line = process.stderr.readline()
        found = re.fullmatch(r"open (http://127\.0\.0\.1:\d+/\S+) on this machine; .*\n", line)
        assert found, line
        with urllib.request.urlopen(found[1], timeout=10) as answer:
            assert answer.status == 200
        process.send_signal(getattr(signal, name))
        out, rest = process.communicate(timeout=30)
    assert process.returncode == code
    assert "recording" in out and "Traceback" not in rest and rest.count("\n") <= 1
    assert not is_open("127.0.0.1", data_port(found[1]))


def test_a_port_that_is_taken_is_refused(file):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(SwimError, match=f"cannot serve on port {port}, choose another"):
            web_viewer(file, port).__enter__()
    with pytest.raises(SwimError, match="from 0 to 65535, got 70000"):
        web_viewer(file, 70000).__enter__()


@pytest.mark.skipif(os.name != "posix", reason="the stand-in is a shell script")
def test_a_viewer_that_does_not_start_is_one_line(file, tmp_path, monkeypatch):
    program = tmp_path / "rerun"
    program.write_text("#!/bin/sh\necho no such luck >&2\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setattr("swim_env.recording.browser._program", lambda: str(program))
    with pytest.raises(SwimError, match="^rerun's viewer has ended at once: no such luck$"):
        web_viewer(file, 0).__enter__()
    with pytest.raises(SwimError, match="no such recording"):
        web_viewer(tmp_path / "none.rrd", 0).__enter__()


def test_a_notebook_gets_the_file(file):
    """The widget has the recording to the byte, for when its page is ready."""
    pytest.importorskip("rerun_notebook")
    widget = show(file, height=500)
    ((about, (content,)),) = widget._event_queue
    assert about == {"type": "rrd"} and content == file.read_bytes()
    with pytest.raises(SwimError, match="cannot read the recording: No such file"):
        show(file.with_name("none.rrd"))


def test_a_notebook_without_the_package_says_what_to_install(file, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun_notebook", None)
    with pytest.raises(SwimError, match="in notebooks need rerun-notebook: install the extra 'vie"):
        show(file)
