"""Hypothesis draws the same examples every time; HYPOTHESIS_PROFILE=explore looks for new ones."""

import os

import hypothesis

hypothesis.settings.register_profile("default", deadline=None, derandomize=True, max_examples=25)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=500)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))
