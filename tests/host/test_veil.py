from __future__ import annotations

import pytest

from prismstereo.veil import Veil

VEIL = Veil(("/srv/people/joanna",), ("joanna",), ("bench7.lab.example", "bench7"))


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("cannot open /srv/people/joanna/rigs/a.toml", "cannot open ~/rigs/a.toml"),
        ("cannot open /home/karl/x and /Users/Eva/y", "cannot open /home/user/x and /Users/user/y"),
        (r"C:\Users\Eva\x.toml", r"C:\Users\user\x.toml"),
        ("url:rtsp://admin:pw1@10.0.0.7/stream", "url:rtsp://10.0.0.7/stream"),
        ("Joanna's on bench7: bench7.lab.example", "user's on host: host"),
        ("token=abc123 then password: xyz", "token=*** then password: ***"),
        ("exposure_us 8000, tokens are none", "exposure_us 8000, tokens are none"),
        ("joannas bench77", "joannas bench77"),
    ],
)
def test_names_homes_and_secrets_are_taken_out_of_a_text(said: str, told: str) -> None:
    assert VEIL.text(said) == told


def test_a_value_is_gone_through_to_its_last_leaf() -> None:
    value = {"a": ["/home/karl/x", 3, None, True], "password": "pw", "token_count": 3, "b": {"c": ("joanna", 1.5)}}
    assert VEIL.plain(value) == {
        "a": ["/home/user/x", 3, None, True],
        "password": "***",
        "token_count": 3,
        "b": {"c": ["user", 1.5]},
    }


def test_bytes_that_name_a_home_folder_are_known() -> None:
    assert VEIL.betrayed_by(b"\x00\x01/srv/people/joanna/x")
    assert not VEIL.betrayed_by(b"joanna")


def test_names_that_say_nothing_are_left_where_they_are() -> None:
    assert Veil(("/",), ("root", "ab", ""), ("localhost",)).text("/ root ab localhost") == "/ root ab localhost"


def test_this_machines_own_home_is_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/srv/homes/somebody-else")
    assert Veil.of_this_machine().text("in /srv/homes/somebody-else/log") == "in ~/log"
