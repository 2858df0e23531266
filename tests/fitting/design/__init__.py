"""Tests of fitting/design."""
