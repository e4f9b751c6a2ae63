"""Named tuples that kernels read by reference: fields, copies and what is refused."""

import copy
import json
import pickle
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from swim_env import Simulator, load_scene
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.references import Referenced, by_value, reader, type_of, words_of
from swim_env.physics.solve.constants import SAMPLE_SCENE
from tests.support import Array, run_python


class Inner(NamedTuple):
    row: Array
    places: Any
    count: int


class Outer(NamedTuple):
    share: float
    inner: Inner
    cube: Array
    flag: bool
    phases: Any


def outer(shift: float = 0.0) -> Outer:
    inner = Inner(np.arange(3.0) + shift, np.array([2, 0]), 7)
    cube = np.arange(24.0).reshape(2, 3, 4) + shift
    return Outer(0.25 + shift, inner, cube, shift == 0.0, np.array([1.0 + 2.0j, 3.0j]) + shift)


outer_at = reader(outer)


@kernel
def _sum(inner: Inner) -> float:
    total = 0.0
    for place in inner.places:
        total += inner.row[place]
    return total + inner.count


@kernel
def _last(inner: Inner) -> float:
    return float(inner.row[inner.row.size - 1])


@entry_kernel
def _read(words: Any, out: Array) -> None:
    for i in range(words.shape[0]):
        one = outer_at(words[i])
        out[i, 0] = one.share
        out[i, 1] = _sum(one.inner)
        out[i, 2] = one.cube[1, 2, 3]
        out[i, 3] = one.cube.shape[1] * 10 + one.cube.shape[2] + one.cube.size / 100
        out[i, 4] = 1.0 if one.flag else 0.0
        out[i, 5] = one.phases[1].imag
        out[i, 6] = _last(by_value(one.inner))


@entry_kernel
def _write(one: Outer, value: float) -> None:
    one.inner.row[1] = value
    one.cube[0, 1, :] = value


def test_a_kernel_reads_every_kind_of_field_of_several_tuples():
    kept = [outer(), outer(100.0)]
    out = np.zeros((2, 7))
    _read(np.array([words_of(one) for one in kept]), out)
    np.testing.assert_array_equal(out[0], [0.25, 2.0 + 7.0, 23.0, 34.24, 1.0, 3.0, 2.0])
    np.testing.assert_array_equal(out[1], [100.25, 202.0 + 7.0, 123.0, 34.24, 0.0, 3.0, 102.0])


def test_what_a_kernel_writes_is_in_the_arrays():
    views = outer()
    _write(Referenced(views), 5.5)
    np.testing.assert_array_equal(views.inner.row, [0.0, 5.5, 2.0])
    assert (views.cube[0, 1] == 5.5).all() and (views.cube[1] == outer().cube[1]).all()


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_has_arrays_of_its_own(duplicate):
    one = Referenced(outer())
    two = duplicate(one)
    _write(two, -1.0)
    np.testing.assert_array_equal(two.inner.row, [0.0, -1.0, 2.0])
    np.testing.assert_array_equal(one.inner.row, [0.0, 1.0, 2.0])


def test_an_array_that_is_not_contiguous_is_refused():
    views = outer()
    with pytest.raises(ValueError, match=r"an array of shape \(4, 3\) is not contiguous"):
        words_of(views._replace(cube=np.zeros((3, 4)).T))


def test_fields_of_another_type_than_a_kernel_reads_are_refused():
    views = outer()
    assert Referenced(views, outer()).share == 0.25
    for other in (views._replace(share=1), views._replace(cube=np.zeros((2, 3)))):
        with pytest.raises(TypeError, match=r"kernels read Outer\(float64, Inner"):
            Referenced(other, outer())


def test_the_type_is_found_once_as_finding_it_takes_longer_than_a_step():
    one = Referenced(outer())
    assert numba.typeof(one) is numba.typeof(one) == type_of(one.views)


def test_a_type_from_another_process_is_found_in_tables():
    """Hashes of names differ between processes, and a kept one would hide the cached code."""
    code = (
        "import pickle; from swim_env.physics.runtime.references import type_of; "
        "from swim_env.physics.solve.constants import SAMPLE_SCENE; "
        "found = type_of(SAMPLE_SCENE); hash(found); print(pickle.dumps(found).hex())"
    )
    found = pickle.loads(bytes.fromhex(run_python("-c", code, PYTHONHASHSEED="1").out))
    assert found in {type_of(SAMPLE_SCENE): "code"}


@pytest.mark.parametrize("model", ["expansion", "panels"])
def test_a_simulator_that_was_sent_to_a_new_process_goes_on_there(model, tmp_path):
    one = Simulator(load_scene("paper_i", {"beam.elements": 3, "fluid.model": model}))
    torques = one.prescribed_torques(12)
    one.rollout(torques[:5])
    path = tmp_path / "simulator"
    path.write_bytes(pickle.dumps((one, torques[5:])))
    code = (
        f"import pickle; s, t = pickle.load(open({str(path)!r}, 'rb')); s.rollout(t); "
        "print(s.centres.tolist())"
    )
    found = run_python("-c", code)
    assert found.code == 0, found.err
    one.rollout(torques[5:])
    np.testing.assert_array_equal(json.loads(found.out), one.centres)


@pytest.mark.parametrize("scene", ["swimmer", "fish_3d"])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copied_simulator_goes_on_by_itself_bit_for_bit(scene, duplicate):
    one = Simulator(scene)
    torques = one.prescribed_torques(12)
    one.rollout(torques[:5])
    two, before = duplicate(one), one.centres.copy()
    two.rollout(torques[5:])
    np.testing.assert_array_equal(one.centres, before)
    one.rollout(torques[5:])
    np.testing.assert_array_equal(one.centres, two.centres)
    assert one.energy() == two.energy()
