"""Hypothesis draws the same examples every time; HYPOTHESIS_PROFILE=explore looks for new ones."""

import os

import hypothesis
import pytest
from children import Child

hypothesis.settings.register_profile("default", deadline=None, derandomize=True, max_examples=25)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=500)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


@pytest.fixture
def child():
    """The engine as a child process."""
    child = Child()
    yield child
    if child.process.poll() is None:
        child.process.terminate()  # it takes its folder along
    child.process.wait()
