from voxjax.io.text_header import header_lines, whole_number


def test_lines_come_with_the_start_of_the_next():
    assert list(header_lines(b"first\none  1\n\ndata\nrest")) == [
        (["one", "1"], 13),
        ([], 14),
        (["data"], 19),
    ]


def test_what_never_ends_is_no_header():
    assert list(header_lines(b"first")) == []
    assert list(header_lines(b"x" * 100 + b"\na\n", most=50)) == []
    assert list(header_lines(b"first\n" + b"x" * 100 + b"\n", most=50)) == []
    assert len(list(header_lines(b"first\n" + b"a\n" * 100, most=50))) == 22


def test_only_numbers_that_a_file_can_mean_are_numbers():
    assert whole_number("0012") == 12
    assert whole_number("9" * 18) == 10**18 - 1
    for text in ("", "-1", "1.0", "1_000", "\u0663", "9" * 19, "9" * 5000):
        assert whole_number(text) is None
