"""An update is taken when its owner signed it for this product and not for an older version; otherwise nothing changes."""

from __future__ import annotations

import hashlib
import io
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat

from device.power_cut import ModelDisk, PowerCut
from prismstereo_device.objects import ObjectNumber, WriteStatus
from prismstereo_device.state import CalibrationSlots, RealDisk, Shelf, Staging
from prismstereo_device.state.disk import Disk
from prismstereo_device.update import Bundle, UpdateInbox, Version, check, read_public_key, write_bundle
from prismstereo_hw.errors import DataError, UsageError

PRODUCT = "prismstereo-oak-1"
HEAD_BYTES = 6  # magic and length
SIGNATURE_BYTES = 64


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A private key's file, and its public key; made for this run only."""
    key = Ed25519PrivateKey.generate()
    file = tmp_path_factory.mktemp("keys") / "private.pem"
    file.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    return file, key.public_key().public_bytes_raw()


@pytest.fixture(scope="module")
def signed(keys: tuple[Path, bytes], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., bytes]:
    """Make bundles of a payload."""
    folder = tmp_path_factory.mktemp("bundles")

    def sign(payload: bytes, version: str = "1.4.0", product: str = PRODUCT) -> bytes:
        (folder / "payload").write_bytes(payload)
        write_bundle(folder / "payload", keys[0], folder / "bundle", product=product, version=version)
        return (folder / "bundle").read_bytes()

    return sign


@pytest.fixture(scope="module")
def good(signed: Callable[..., bytes]) -> bytes:
    return signed(random.Random(1).randbytes(9000))


def checked(bundle: bytes, public_key: bytes, **options: object) -> Bundle:
    given = {"product": PRODUCT, "installed_version": "1.3.9", **options}
    return check(io.BytesIO(bundle), public_key, **given)


def test_a_good_bundle_is_described(good: bytes, keys: tuple[Path, bytes], tmp_path: Path) -> None:
    payload = random.Random(1).randbytes(9000)
    bundle = checked(good, keys[1])
    assert (bundle.product, bundle.version, bundle.size) == (PRODUCT, Version((1, 4)), 9000)
    assert bundle.sha256 == hashlib.sha256(payload).digest()
    assert good[bundle.payload_offset :] == payload
    (tmp_path / "bundle").write_bytes(good)
    assert check(tmp_path / "bundle", keys[1], product=PRODUCT, installed_version="1.4") == bundle


def test_a_bundle_is_laid_out_as_its_page_says(good: bytes) -> None:
    sha256 = hashlib.sha256(good[-9000:]).hexdigest()
    header = f'{{"product":"{PRODUCT}","version":"1.4.0","size":9000,"sha256":"{sha256}"}}'.encode()
    assert good[:-9064] == b"PSU\n" + len(header).to_bytes(2, "little") + header


def test_a_flipped_bit_anywhere_is_refused(good: bytes, keys: tuple[Path, bytes]) -> None:
    head = (len(good) - 9000) * 8
    rng = random.Random(21)
    places = [*range(head), *(rng.randrange(head, len(good) * 8) for _ in range(300))]
    for at in places:
        flipped = bytearray(good)
        flipped[at // 8] ^= 1 << at % 8
        with pytest.raises(DataError):
            checked(bytes(flipped), keys[1])


def test_a_bundle_cut_or_grown_at_any_place_is_refused(good: bytes, keys: tuple[Path, bytes]) -> None:
    rng = random.Random(22)
    for length in [0, 1, len(good) - 1, *(rng.randrange(len(good)) for _ in range(200))]:
        with pytest.raises(DataError, match="cut"):
            checked(good[:length], keys[1])
    with pytest.raises(DataError, match="more behind"):
        checked(good + b"\0", keys[1])


def test_a_bundle_signed_by_somebody_else_is_refused(good: bytes) -> None:
    stranger = Ed25519PrivateKey.generate().public_key().public_bytes_raw()
    with pytest.raises(DataError, match="not signed by the owner"):
        checked(good, stranger)


def test_a_bundle_for_another_product_is_refused(good: bytes, keys: tuple[Path, bytes]) -> None:
    with pytest.raises(DataError, match="is for 'prismstereo-oak-1', and this camera is a 'prismstereo-pi'"):
        checked(good, keys[1], product="prismstereo-pi")


def test_an_older_version_is_refused_unless_the_configuration_allows_it(good: bytes, keys: tuple[Path, bytes]) -> None:
    for installed in ("1.4.1", "1.10", "2"):
        with pytest.raises(DataError, match=rf"version 1\.4\.0, older than the installed {installed}"):
            checked(good, keys[1], installed_version=installed)
        assert checked(good, keys[1], installed_version=installed, allow_downgrade=True).version == Version((1, 4))


@pytest.mark.parametrize(
    "text",
    [
        b'{"product":"p","version":"9","size":9000,"sha256":"' + b"0" * 64 + b'"} ',  # not canonical
        b'{"version":"9","product":"p","size":9000,"sha256":"' + b"0" * 64 + b'"}',
        b'{"product":"p","version":"9","size":1e9,"sha256":"' + b"0" * 64 + b'"}',
        b'{"product":"p","version":"9","size":99999999999,"sha256":"' + b"0" * 64 + b'"}',
        b'{"product":"../p","version":"9","size":9000,"sha256":"' + b"0" * 64 + b'"}',
        b'{"product":"p","version":"1.0-rc1","size":9000,"sha256":"' + b"0" * 64 + b'"}',
        b"[" * 1000,
        b"\xff",
    ],
)
def test_a_header_of_another_form_is_refused_even_where_it_is_signed(text: bytes, keys: tuple[Path, bytes]) -> None:
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    key = load_pem_private_key(keys[0].read_bytes(), None)
    assert isinstance(key, Ed25519PrivateKey)
    head = b"PSU\n" + len(text).to_bytes(2, "little") + text
    with pytest.raises(DataError, match=r"header|version"):
        checked(head + key.sign(head) + bytes(9000), keys[1], product="p")


@pytest.mark.parametrize(
    ("older", "newer"), [("1", "1.0.1"), ("1.9", "1.10"), ("0.9.9.9", "1"), ("1.2", "1.2.0.1"), ("9", "10")]
)
def test_versions_are_compared_number_by_number(older: str, newer: str) -> None:
    assert Version.parse(older) < Version.parse(newer)
    assert Version.parse(older) == Version.parse(older + ".0"[: 2 * (older.count(".") < 3)])


@pytest.mark.parametrize("text", ["", "1.", ".1", "v1", "1.2.3.4.5", "01", "1.2rc1", "-1", "1 ", "1\n", "٣", "1" * 10])
def test_a_version_of_another_form_is_refused(text: str) -> None:
    with pytest.raises(DataError, match="whole numbers"):
        Version.parse(text)


def test_only_an_ed25519_key_is_taken(keys: tuple[Path, bytes], tmp_path: Path) -> None:
    public = tmp_path / "public.pem"
    private = Ed25519PrivateKey.generate()
    public.write_bytes(private.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    assert read_public_key(public) == private.public_key().public_bytes_raw()
    other = X25519PrivateKey.generate()
    public.write_bytes(other.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    with pytest.raises(UsageError, match="another kind of key"):
        read_public_key(public)
    for content in (b"", b"key", keys[0].read_bytes()):
        public.write_bytes(content)
        with pytest.raises(UsageError, match="no public key"):
            read_public_key(public)
    with pytest.raises(UsageError, match="cannot read"):
        read_public_key(tmp_path / "absent.pem")


def test_a_bundle_that_no_camera_would_take_is_not_made(keys: tuple[Path, bytes], tmp_path: Path) -> None:
    payload, other, bundle = tmp_path / "payload", tmp_path / "other.pem", tmp_path / "bundle"
    payload.write_bytes(b"x")
    other.write_bytes(b"key")

    def make(payload: Path = payload, key: Path = keys[0], product: str = PRODUCT, version: str = "1.0") -> None:
        write_bundle(payload, key, bundle, product=product, version=version)

    with pytest.raises(UsageError, match="no private key"):
        make(key=other)
    with pytest.raises(UsageError, match=r"cannot read.*absent"):
        make(key=tmp_path / "absent")
    with pytest.raises(UsageError, match=r"cannot read.*absent"):
        make(payload=tmp_path / "absent")
    with pytest.raises(DataError, match="whole numbers"):
        make(version="1.0rc1")
    with pytest.raises(UsageError, match="product"):
        make(product="../x")
    payload.write_bytes(b"")
    with pytest.raises(UsageError, match="0 bytes"):
        make()
    assert not bundle.exists()


def test_cryptography_is_not_imported_before_an_update_arrives() -> None:
    seen = "import sys, prismstereo_device.state, prismstereo_device.update; print('cryptography' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def camera(disk: Disk, public_key: bytes) -> tuple[Shelf, UpdateInbox]:
    inbox = UpdateInbox(disk, public_key, product=PRODUCT, installed_version="1.3.9")
    return Shelf(CalibrationSlots(disk), Staging(disk), accepts=lambda content: None, updates=inbox), inbox


def send(shelf: Shelf, bundle: bytes) -> WriteStatus:
    obj, sha256 = ObjectNumber.UPDATE, hashlib.sha256(bundle).digest()
    progress = shelf.begin(obj, len(bundle), sha256)
    while progress.status is WriteStatus.OK and progress.held < len(bundle):
        progress = shelf.write(obj, progress.held, bundle[progress.held : progress.held + 4000])
    return shelf.commit(obj, len(bundle), sha256).status if progress.status is WriteStatus.OK else progress.status


def test_a_good_bundle_waits_for_the_updater_and_a_bad_one_changes_nothing(
    good: bytes, keys: tuple[Path, bytes], signed: Callable[..., bytes], tmp_path: Path
) -> None:
    shelf, inbox = camera(RealDisk(tmp_path), keys[1])
    assert inbox.waiting() is None
    assert send(shelf, good) is WriteStatus.OK
    assert (tmp_path / "update" / "bundle").read_bytes() == good
    said = dict(line.split("=") for line in (tmp_path / "update" / "ready").read_text().splitlines())
    assert said["version"] == "1.4.0"
    assert good[int(said["offset"]) :] == random.Random(1).randbytes(9000)
    before = {path: path.read_bytes() for path in (tmp_path / "update").iterdir()}
    flipped = good[:-1] + bytes([good[-1] ^ 1])
    for bad in (flipped, good[:-1], b"x", signed(b"x", "1.3.8"), signed(b"x", product="prismstereo-pi")):
        assert send(shelf, bad) is WriteStatus.REFUSED
        assert {path: path.read_bytes() for path in (tmp_path / "update").iterdir()} == before
        assert list((tmp_path / "staging").iterdir()) == []
    assert inbox.waiting() == checked(good, keys[1])
    assert send(shelf, signed(b"newer", "1.5")) is WriteStatus.OK
    waiting = inbox.waiting()
    assert waiting is not None
    assert waiting.version_text == "1.5"


def cut_updates(runs: int, seed: int, public_key: bytes, old: bytes, new: bytes) -> dict[str, int]:
    """Cut the power while a new bundle is sent over an old one that waits; then send it again; count what was found."""
    rng = random.Random(seed)
    found = {"old": 0, "none": 0, "new": 0}
    disk = ModelDisk()
    assert send(camera(disk, public_key)[0], old) is WriteStatus.OK
    whole = {name: bytes(file.now) for name, file in disk.files.items()}
    trial = ModelDisk(whole)
    assert send(camera(trial, public_key)[0], new) is WriteStatus.OK
    calls = trial.calls
    for run in range(runs):
        disk = ModelDisk(whole)
        disk.cut_at = run if run < calls else rng.randrange(calls)
        with pytest.raises(PowerCut):
            send(camera(disk, public_key)[0], new)
        disk = disk.after_a_cut(rng)
        shelf, inbox = camera(disk, public_key)
        ready = "update/ready" in disk.names("update")
        waiting = inbox.waiting()
        assert not ready or waiting is not None, f"run {run}: what is said to be ready is not"
        found["none" if waiting is None else "old" if waiting.version_text == "1.4.0" else "new"] += 1
        assert send(shelf, new) is WriteStatus.OK
        last = inbox.waiting()
        assert last is not None
        assert last.version_text == "2.0"
    return found


def test_a_power_cut_while_an_update_is_taken_leaves_a_whole_bundle_or_none(
    good: bytes, keys: tuple[Path, bytes], signed: Callable[..., bytes]
) -> None:
    found = cut_updates(200, 5, keys[1], good, signed(random.Random(2).randbytes(40_000), "2.0"))
    assert found["old"] > 20
    assert found["new"] > 0


@pytest.mark.soak
def test_thousands_of_power_cuts_leave_a_whole_bundle_or_none(
    good: bytes, keys: tuple[Path, bytes], signed: Callable[..., bytes]
) -> None:
    found = cut_updates(5000, 6, keys[1], good, signed(random.Random(2).randbytes(40_000), "2.0"))
    print(f"\n5000 power cuts while an update is taken over an older one that waits: {found}, never a broken one")
