from __future__ import annotations

import datetime as dt
import ssl
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from host.command import in_process
from host.viewer_rig import SmallViewer, small_viewer
from prismstereo.cli.view import command
from prismstereo.viewer.serving import ViewerServer
from prismstereo_hw.errors import DataError, DeviceError, UsageError
from prismstereo_hw.rig import Rig


@pytest.fixture(scope="module")
def viewer(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SmallViewer]:
    with small_viewer(small, tmp_path_factory.mktemp("records")) as viewer:
        yield viewer


def _certificate(folder: Path) -> tuple[Path, Path]:
    """Make a key and a certificate for 127.0.0.1 that nobody else has signed."""
    import ipaddress

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key, name = ec.generate_private_key(ec.SECP256R1()), x509.Name([])
    now = dt.datetime.now(dt.UTC)
    own = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), 7, now, now + dt.timedelta(days=1))
        .add_extension(own, critical=False)
        .sign(key, hashes.SHA256())
    )
    paths = folder / "cert.pem", folder / "key.pem"
    paths[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    paths[1].write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return paths


def test_a_certificate_makes_it_https(viewer: SmallViewer, tmp_path: Path) -> None:
    certificate, key = _certificate(tmp_path)
    with ViewerServer(viewer.hub, certificate=certificate, key=key) as server:
        trust = ssl.create_default_context(cafile=str(certificate))
        with httpx.Client(verify=trust) as client:
            answer = client.get(server.url)
            entered = client.post(f"{server.url}api/enter", headers={"origin": server.url.rstrip("/")}, json={})

    assert server.url.startswith("https://127.0.0.1:")
    assert answer.status_code == 200
    assert "Secure" in entered.headers["set-cookie"]


def test_a_certificate_without_its_key_is_refused(tmp_path: Path) -> None:
    certificate, _ = _certificate(tmp_path)

    with pytest.raises(UsageError, match="belong together"):
        in_process(command, "simulated", "--tls-cert", certificate)


def test_a_file_that_is_no_certificate_is_refused_by_name(viewer: SmallViewer, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.pem"
    wrong.write_text("nothing")

    with pytest.raises(UsageError, match=r"wrong\.pem"):
        ViewerServer(viewer.hub, certificate=wrong, key=wrong)


def test_a_port_that_is_taken_is_named(viewer: SmallViewer) -> None:
    with pytest.raises(UsageError, match=f"port {viewer.server.port}"):
        ViewerServer(viewer.hub, port=viewer.server.port)


def test_an_address_of_another_machine_is_refused(viewer: SmallViewer) -> None:
    with pytest.raises(UsageError, match=r"cannot listen on 192\.0\.2\.1"):
        ViewerServer(viewer.hub, address="192.0.2.1")


def test_what_cannot_be_opened_is_said_before_anything_is_served(tmp_path: Path) -> None:
    with pytest.raises(DeviceError):
        in_process(command, "/dev/no-such-port", "--no-browser")
    with pytest.raises(DataError):
        in_process(command, tmp_path / "none.mcap", "--no-browser")
