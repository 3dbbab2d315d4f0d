"""What the tests of the command line share: ways to spoil a session, and what a refusal is."""

QUICK = ("--methods", "least_squares", "--quiet")
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"


def spoil(folder, change, name="log0001.csv"):
    """Change the list of a log's lines (0: comment, 1: header)."""
    path = folder / name
    lines = path.read_text().split("\n")
    path.write_text("\n".join(change(lines)))


def refused(result, *words):
    """Exit code 2 and one line, without a traceback, that says every word."""
    code, out, err = result
    lines = err.strip().split("\n")
    assert code == 2, (code, err)
    assert len(lines) == 1, err
    assert lines[0].startswith("calibrate: "), err
    assert "Traceback" not in out + err
    for word in words:
        assert word in lines[0], (word, lines[0])
