"""The progress display."""

import io

from voxjax.cli.progress import Progress


class _Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_file_gets_one_line_a_stage_that_has_ended():
    stream = io.StringIO()
    progress = Progress(stream=stream)
    progress("read")
    progress("merge", "more", 3)
    assert [line.split(" s  ")[1] for line in stream.getvalue().splitlines()] == ["read"]
    progress.finish()
    progress.finish()
    assert [line.split(" s  ")[1] for line in stream.getvalue().splitlines()] == ["read", "merge"]
    assert set(progress.seconds) == {"read", "merge"}


def test_a_terminal_also_sees_the_running_stage():
    stream = _Terminal()
    Progress(stream=stream)("read")
    assert "read ..." in stream.getvalue()


def test_quiet_writes_nothing_but_keeps_the_seconds():
    stream = io.StringIO()
    progress = Progress(quiet=True, stream=stream)
    progress("read")
    progress.finish()
    assert stream.getvalue() == ""
    assert progress.seconds["read"] >= 0.0
