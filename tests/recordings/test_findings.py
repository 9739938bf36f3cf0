from pfslam_viz.recordings.findings import Finding, in_order, verdict

NOTE = Finding("note", "b", "odd")
DOUBT = Finding("doubtful", "a", "this is odd", "look at it", 3)
WRONG = Finding("wrong", "c", "this is broken", "mend it")


def test_verdict() -> None:
    assert verdict([]) == verdict([NOTE]) == "good"
    assert verdict([NOTE, DOUBT]) == "1 doubt"
    assert verdict([DOUBT, DOUBT]) == "2 doubts"
    assert verdict([NOTE, DOUBT, WRONG]) == "cannot be replayed: this is broken"
    assert verdict([WRONG, DOUBT, WRONG]) == "cannot be replayed: this is broken (and 1 more)"


def test_the_worst_comes_first() -> None:
    assert in_order([NOTE, DOUBT, WRONG, NOTE]) == [WRONG, DOUBT, NOTE, NOTE]


def test_as_text() -> None:
    assert (DOUBT.line, NOTE.line) == ("this is odd; look at it", "odd")
    assert DOUBT.as_dict() == {
        "severity": "doubtful", "what": "a", "message": "this is odd", "advice": "look at it", "scan": 3,
    }  # fmt: skip
