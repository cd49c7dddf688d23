"""Standard output and error that end no command."""

import os

import pytest

from voxjax.cli.streams import LastingStream, lasting_streams, printable, tell, warn


@pytest.fixture
def pipe_without_reader():
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as stream:
        yield stream


def test_a_reader_that_has_gone_is_remembered_and_no_error(pipe_without_reader):
    stream = LastingStream(pipe_without_reader)
    stream.write("first\n")
    stream.flush()
    assert isinstance(stream.failure, BrokenPipeError)
    assert stream.write("second\n") == 7
    stream.flush()


def test_a_full_disk_is_remembered():
    with open("/dev/full", "w") as full:
        stream = LastingStream(full)
        for _ in range(3):
            stream.write("x" * 10_000)
        stream.flush()
    assert stream.failure is not None
    assert stream.failure.strerror == "No space left on device"


def test_a_closed_stream_swallows_all():
    stream = LastingStream(None)
    assert stream.write("text") == 4
    stream.flush()
    assert not stream.isatty()
    assert stream.failure is None


def test_what_cannot_be_encoded_is_escaped(tmp_path):
    with open(tmp_path / "out.txt", "w", encoding="ascii") as ascii_only:
        LastingStream(ascii_only).write("über \udcff\n")
    assert (tmp_path / "out.txt").read_bytes() == b"\\xfcber \\udcff\n"


def test_print_reaches_the_streams_and_they_are_put_back(capsys):
    with lasting_streams() as output:
        tell("a\nb")
        warn("two\n  words \x1b[31m")
    print("after")
    shown = capsys.readouterr()
    assert output.failure is None
    assert shown.out == "a\\nb\nafter\n"
    assert shown.err == "voxjax: two words \\x1b[31m\n"


def test_one_line_of_printable_letters():
    assert printable("a b/ü.bt") == "a b/ü.bt"
    assert printable("\r\n\t\x00\x7f\udcff\u2028\u202e") == "\\r\\n\\t\\x00\\x7f\\udcff\\u2028\\u202e"


def test_long_sentences_keep_their_beginning_and_end(capsys):
    warn(f"the beginning {'x' * 100_000} the end")
    line = capsys.readouterr().err
    assert len(line) < 1300
    assert line.startswith("voxjax: the beginning")
    assert line.endswith("the end\n")
