"""Messages of a reader about a file: once, counted, and with the place of the first."""

from bench_protocol.account import Account


def test_what_was_left_out_is_counted_in_words() -> None:
    account = Account()
    account.leave_out("CAN FD frame(s)", 50)
    for line in (7, 9):
        account.leave_out("line(s) of unknown form", at=f"line {line}")
    account.leave_out("error frame(s)", at="line 3")
    account.leave_out("remote frame(s)", 0)
    assert (
        account.left_out
        == "50 CAN FD frames, 2 lines of unknown form (the first: line 7), 1 error frame (line 3)"
    )


def test_two_accounts_merge_without_repetition() -> None:
    one, other = Account(), Account()
    for account in (one, other):
        account.take("the times are Unix times")
        account.leave_out("error frame(s)", 2, "line 3")
    one.add(other)
    assert one.lines() == ["the times are Unix times", "left out: 4 error frames (the first: line 3)"]
    assert one.as_meta() == {
        "reading": {"taken": ["the times are Unix times"], "left_out": {"error frame(s)": 4}}
    }
    assert Account().lines() == [] and Account().as_meta() == {}
