"""The user-provided noise model of docs/guide/sensor.md does what the page says, under the name
that its command uses.
"""

import re
import sys

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.models import depth_model


@pytest.fixture
def model(repository, tmp_path, monkeypatch):
    text = (repository / "docs/guide/sensor.md").read_text()
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    name = re.search(r"--depth-noise (\w+:\w+)", text.split("```python")[1]).group(1)
    assert len(code.splitlines()) < 20
    (tmp_path / f"{name.split(':')[0]}.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    yield depth_model(name)
    sys.modules.pop(name.split(":")[0], None)


def test_it_grows_with_depth_comes_in_steps_and_ends_at_five_metres(model):
    depth = np.repeat([[0.0, 1.0, 3.0, 6.0]], 20000, 0)
    noisy = model.apply(depth, PinholeCamera(), np.random.default_rng(1))
    assert (noisy[:, 0] == 0).all() and (noisy[:, 3] == 0).all()
    assert noisy[:, 2].std() / noisy[:, 1].std() == pytest.approx(9, rel=0.1)
    assert np.allclose(noisy / 0.002, np.rint(noisy / 0.002))
    assert np.array_equal(noisy, model.apply(depth, PinholeCamera(), np.random.default_rng(1)))
