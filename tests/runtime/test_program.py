import jax
import numpy as np
import pytest

from voxjax._runtime.calls import Call
from voxjax._runtime.program import Program, traced

VALUES = np.asarray([1.0, 2.0, 4.0], np.float32)


def scaled(values, *, times=2):
    return {"twice": times * values, "sum": values.sum()}


@pytest.fixture(scope="module")
def content():
    written = traced(scaled, Call.of((VALUES,), {"times": 3}))
    assert written is not None
    return written


def test_a_program_written_down_gives_what_the_function_gives(content):
    program = Program.of(content)
    assert program is not None
    program.compile()
    run = program.runner(Call.of((2 * VALUES,), {"times": 3}))
    assert run is not None
    found = run(2 * VALUES)
    np.testing.assert_array_equal(found["twice"], 6 * VALUES)
    assert float(found["sum"]) == 14.0


def test_it_runs_on_no_arrays_that_it_was_not_traced_for(content):
    program = Program.of(content)
    assert program is not None
    assert program.runner(Call.of((VALUES[:2],), {})) is None
    assert program.runner(Call.of((VALUES.astype(np.int32),), {})) is None
    assert program._replace(results={"type": "nobody's"}).runner(Call.of((VALUES,), {})) is None


@pytest.mark.parametrize("cut", [0, 3, 20, 140])
def test_bytes_that_are_none_are_no_program(content, cut):
    assert Program.of(content[:cut]) is None
    assert Program.of(b"\xff" * 64) is None


def test_results_of_types_that_cannot_be_written_down_have_no_program():
    @jax.tree_util.register_pytree_node_class
    class Own:
        def __init__(self, value):
            self.value = value

        def tree_flatten(self):
            return (self.value,), None

        @classmethod
        def tree_unflatten(cls, _, children):
            return cls(*children)

    assert traced(lambda values: Own(values + 1), Call.of((VALUES,), {})) is None
