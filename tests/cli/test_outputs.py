"""Output files are checked before the work."""

import json
from pathlib import Path

import pytest

from command_line import fake_register, one_line
from voxjax import InputError
from voxjax.cli.main import main
from voxjax.cli.outputs import check_outputs, json_bytes


def test_outputs_are_refused_before_the_maps_are_registered(monkeypatch, maps):
    fake = fake_register(monkeypatch)
    Path("r.json").write_text("mine")
    assert main(["merge", *maps, "-o", "out.bt", "--report", "r.json"]) == 2
    assert fake.calls == []
    assert Path("r.json").read_text() == "mine"
    assert main(["merge", *maps, "-o", "out.bt", "--report", "r.json", "--force"]) == 0
    assert Path("r.json").read_text() != "mine"


@pytest.mark.parametrize(
    ("outputs", "reason"),
    [
        ([("a.txt", (".bt", ".ot"))], r"a\.txt: the ending must be \.bt or \.ot"),
        ([("no/a.bt", (".bt",))], "does not exist"),
        ([("a.bt", (".bt",)), ("./a.bt", (".bt",))], "given for two outputs"),
        ([("link.bt", (".bt",))], "leads nowhere; use --force"),
        ([("x" * 300 + ".bt", (".bt",))], "File name too long"),
        ([("", (".bt",))], "the ending must be"),
    ],
)
def test_names_that_cannot_be_written_are_refused(folder, outputs, reason):
    Path("link.bt").symlink_to("nowhere")
    with pytest.raises(InputError, match=reason):
        check_outputs(outputs, force=False)


@pytest.mark.parametrize("name", ["m0.npz", "./m0.npz", "link.npz"])
def test_an_output_never_replaces_an_input(monkeypatch, maps, capsys, name):
    fake = fake_register(monkeypatch)
    Path("link.npz").symlink_to("m0.npz")
    before = Path("m0.npz").read_bytes()
    for command in (["merge", *maps, "-o", name], ["convert", "m0.npz", name]):
        for force in ([], ["--force"]):
            assert main([*command, *force]) == 2
            assert one_line(capsys) == (
                f"voxjax: {name} is one of the inputs, which are never replaced; use another name."
            )
    assert fake.calls == []
    assert Path("m0.npz").read_bytes() == before


def test_what_exists_is_said_with_the_option_of_the_command(maps, capsys):
    assert main(["convert", "m0.npz", "m1.npz"]) == 2
    assert one_line(capsys) == (
        "voxjax: m1.npz exists already; use --force to overwrite it, or another name."
    )


def test_names_that_can_be_written_pass(folder):
    Path("link.bt").symlink_to("nowhere")
    check_outputs([("a.bt", (".bt",)), (None, (".json",)), ("b.JSON", (".json",))], force=False)
    check_outputs([("link.bt", (".bt",))], force=True)


def test_a_working_folder_that_is_gone_is_said(folder, monkeypatch):
    gone = folder / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(InputError, match=r"a\.bt.*folder"):
        check_outputs([("a.bt", (".bt",))], force=False)


def test_json_never_holds_what_is_no_number():
    assert json.loads(json_bytes({"a": [1.5, None]})) == {"a": [1.5, None]}
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_bytes({"a": float("nan")})
