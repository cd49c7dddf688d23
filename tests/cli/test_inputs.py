"""Names of files that cannot be, and files of settings that hold what no settings are."""

import os
import re

import pytest

from voxjax import InputError
from voxjax.cli.inputs import check_inputs, read_config


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("nowhere.bt", "No such file"),
        ("", "No such file"),
        (".", "folder"),
        ("x" * 300 + ".bt", "File name too long"),
        ("d/" * 3000 + "x.bt", "File name too long"),
        ("a\0b.bt", "embedded null byte"),
        ("loop.bt", "Too many levels of symbolic links"),
        ("\udcff.bt", "No such file"),
    ],
)
def test_names_of_no_file_are_refused(tmp_path, monkeypatch, name, reason):
    monkeypatch.chdir(tmp_path)
    os.symlink("loop.bt", "loop.bt")
    with pytest.raises(InputError, match=f"cannot be read: .*{reason}"):
        check_inputs([name])


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "as Windows marks UTF-8"])
def test_settings_are_read(tmp_path, mark):
    path = tmp_path / "s.toml"
    path.write_bytes(mark + b"[source]\ndescriptors = false\n")
    config = read_config(str(path))
    assert config.source.descriptors is False
    assert config.source.corners is True


NO_SETTINGS = {
    "no TOML": (b"= 3", "is no TOML file"),
    "Latin 1": (b"a = '\xfc'", "is not UTF-8"),
    "UTF-16": ("[map]".encode("utf-16"), "is not UTF-8"),
    "nested arrays": (b"a = " + b"[" * 20_000, "nested too deeply"),
    "nested names": (b"map.voxel_size" + b".b" * 2_000 + b" = 1", "map.voxel_size must be|nested too deeply"),
    "many digits": (b"a = " + b"9" * 5_000, "is no TOML file"),
    "no number of float64": (b"[verdict]\nmin_confidence = " + b"9" * 400, "min_confidence|no TOML file"),
    "long text": (b"[verdict]\nmin_confidence = '" + b"x" * 20_000 + b"'", "min_confidence must be"),
    "unknown table": (b"speed = 3", "has no table 'speed'"),
    "huge": (b"# " + b"x" * 40_000, "cannot be read: it holds 40,002 bytes"),
}


@pytest.mark.parametrize("case", NO_SETTINGS)
def test_what_is_no_file_of_settings_is_refused(tmp_path, case):
    content, reason = NO_SETTINGS[case]
    path = tmp_path / "s.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}.*({reason})"):
        read_config(str(path))
