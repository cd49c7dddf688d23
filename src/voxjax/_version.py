"""The version of voxjax, at the bottom of all imports."""

__version__ = "0.2.0"
