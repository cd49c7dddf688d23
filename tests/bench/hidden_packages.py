"""Packages that are as good as not installed."""

import importlib


def hide(monkeypatch, package):
    """Let the import of a package by its name fail for the rest of the test."""
    real = importlib.import_module

    def import_module(name, *rest):
        if name == package:
            raise ImportError(f"No module named {package!r}")
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", import_module)
