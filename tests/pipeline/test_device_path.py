"""`register` in the form that it has on an accelerator, run on the CPU and lowered for CUDA."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from device_path import Recorder, call_lowered_for_cuda, device_path, lowered_for_cuda
from small_worlds import draw_map, pose

STAGES = {
    "voxjax.maps": ("evidence.nearest.", "evidence.scoring.evidence_codes", "surface.moments."),
    "voxjax.registration.hypotheses": ("evidence.correlate.", "hypotheses.rotations."),
    "voxjax.registration.judging": ("evidence.scoring.", "evidence.align."),
    "voxjax.refinement": ("refinement.solve.",),
}
"""Stages of `register`, and what the names of the compiled functions that each calls hold."""


@pytest.fixture(scope="module")
def registered():
    """A pair registered by either form, and what the device's form called."""
    frame_b = pose(yaw=33.0, translation=(3.0, -2.0, 1.0))
    a, b = draw_map(), draw_map(frame_b)
    recorder = Recorder()
    on_host = vx.register(a, b)
    with device_path(), recorder.watching():
        on_device = vx.register(a, b)
    return on_host, on_device, frame_b, recorder.calls


def test_both_forms_come_to_the_same_verdict_and_pose(registered):
    on_host, on_device, frame_b, _ = registered
    assert on_host.verdict == on_device.verdict == "accepted"
    np.testing.assert_allclose(on_device.T_a_b, on_host.T_a_b, atol=1e-3)
    np.testing.assert_allclose(on_device.T_a_b, np.linalg.inv(frame_b), atol=0.05)


def test_each_stage_is_lowered_for_cuda(registered):
    calls = registered[3]
    for stage, names in STAGES.items():
        for name in names:
            assert any(name in call for call in calls), f"{stage} called nothing of {name}"
    for name, call in calls.items():
        assert "func.func" in call_lowered_for_cuda(*call), name


def test_a_gradient_of_the_refinement_is_lowered_for_cuda(registered):
    name = next(name for name in registered[3] if "pose.solve_pose" in name)
    function, (problem, *rest), kwargs = registered[3][name]
    floats, others = eqx.partition(problem, eqx.is_inexact_array)

    def moved(floats):
        return jnp.sum(function(eqx.combine(floats, others), *rest, **kwargs).T_a_b, dtype=jnp.float32)

    assert "func.func" in lowered_for_cuda(jax.grad(moved), floats)
