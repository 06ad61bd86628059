"""uv installs from the indexes that pip is configured for."""

import os
import subprocess
import sys

import install
import pytest


def test_the_indexes_of_pip_are_handed_to_uv(tmp_path):
    (tmp_path / "pip.conf").write_text(
        "[global]\nindex-url = https://a/simple\nextra-index-url =\n  https://b/simple\n  https://c\n"
        "cert = /of/all.pem\n[install]\ncert = /of/installing.pem\n"
        "[download]\ncert = /of/downloading.pem\n"
    )
    environment = {"PATH": os.environ["PATH"], "PIP_CONFIG_FILE": str(tmp_path / "pip.conf")}
    listed = subprocess.check_output(
        [*install.PIP, "config", "list"],
        env=environment | {"PIP_FIND_LINKS": "/wheels /more"},
        text=True,
    )
    options, variables = install.as_uv(listed)
    pairs = set(zip(options[::2], options[1::2]))
    assert pairs >= {
        ("--default-index", "https://a/simple"),
        ("--index", "https://b/simple"),
        ("--index", "https://c"),
        ("--find-links", "/wheels"),
        ("--find-links", "/more"),
    }
    assert variables["SSL_CERT_FILE"] == "/of/installing.pem"
    assert "--no-index" not in options


def test_without_an_index_uv_has_none():
    options, _ = install.as_uv(":env:.no-index='1'\n:env:.find-links='/wheels'\n")
    assert options[-3:] == ["--find-links", "/wheels", "--no-index"]


@pytest.mark.parametrize("status", [0, 1])
def test_pip_installs_only_where_uv_fails(status, monkeypatch, tmp_path):
    called = []

    def call(command, **options):
        called.append([str(word) for word in command])
        return status if len(called) == 1 else 0

    (tmp_path / "uv").touch()
    monkeypatch.setattr(install.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(install.subprocess, "check_output", lambda *a, **o: "")
    monkeypatch.setattr(install.subprocess, "call", call)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(sys, "argv", ["install.py", "-e", ".[ros]"])
    assert install.main() == 0
    assert called[0][0] == str(tmp_path / "uv")
    assert [command[:4] for command in called[1:]] == [[*install.PIP]] * status
    assert all(command[-2:] == ["-e", ".[ros]"] for command in called)
