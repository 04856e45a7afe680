"""Fetching of a packed sequence: verified, resumed, and never another file than that of the list."""

import hashlib
import http.server
import threading

import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.sequences import fetching
from iclnuim.sequences.fetching import CHECKSUMS, fetch, source_of, unpack

#: Bytes of the largest file: many pieces.
_SIZE = 1_000_003


@pytest.fixture
def packed(tmp_path):
    """A folder as pack_shards writes it, of made-up files."""
    folder = tmp_path / "packed"
    folder.mkdir()
    files = {"a-000000.tar": bytes(range(256)) * 4000, "camera.json": b"{}", "empty.txt": b""}
    files["a-000000.tar"] = (files["a-000000.tar"] * 2)[:_SIZE]
    lines = []
    for name, data in files.items():
        (folder / name).write_bytes(data)
        lines.append(f"{hashlib.sha256(data).hexdigest()}  {name}\n")
    (folder / CHECKSUMS).write_text("".join(lines))
    return folder


@pytest.fixture
def server():
    """`server(handler)`: the address of a server on this machine."""
    running = []

    def start(handler):
        made = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=made.serve_forever, daemon=True).start()
        running.append(made)
        return f"http://127.0.0.1:{made.server_port}/"

    yield start
    for one in running:
        one.shutdown()
        one.server_close()


class Handler(http.server.BaseHTTPRequestHandler):
    """Serves a folder, with ranges."""

    folder = None
    ranges = True

    def log_message(self, *words):
        pass

    def data(self):
        return (self.folder / self.path.strip("/")).read_bytes()

    def do_GET(self):
        try:
            data = self.data()
        except OSError:
            self.send_error(404)
            return
        start = 0
        asked = self.headers.get("Range")
        if asked and self.ranges:
            start = int(asked.removeprefix("bytes=").rstrip("-"))
            if start >= len(data):
                self.send_error(416)
                return
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
        else:
            self.send_response(200)
        self.send_header("Content-Length", str(len(data) - start))
        self.end_headers()
        self.give(data[start:])

    def give(self, data):
        self.wfile.write(data)


def handler(base, **attributes):
    return type("Made", (base,), attributes)


def same(a, b):
    names = [{path.name for path in folder.iterdir()} for folder in (a, b)]
    return names[0] == names[1] and all(
        (a / name).read_bytes() == (b / name).read_bytes() for name in names[0]
    )


def test_a_folder_and_a_server_give_the_same_files(packed, server, tmp_path, command_here):
    address = server(handler(Handler, folder=packed))
    for source, out in ((packed, tmp_path / "a"), (address, tmp_path / "b")):
        code, text, _ = command_here("fetch", source, "-o", out)
        assert code == 0 and "3 files fetched, 0 found" in text and same(packed, out)
        code, text, _ = command_here("fetch", source, "-o", out)
        assert code == 0 and "0 files fetched, 3 found" in text


def test_a_server_that_breaks_off_twenty_times_is_asked_twenty_times_more(packed, server, tmp_path):
    breaks = []

    def give(self, data):
        if "tar" in self.path and len(breaks) < 20:
            breaks.append(len(data))
            self.wfile.write(data[:40_000])
            self.wfile.flush()
            self.connection.close()
        else:
            self.wfile.write(data)

    address = server(handler(Handler, folder=packed, give=give))
    fetch(source_of(address), tmp_path / "out")
    assert len(breaks) == 20 and breaks == sorted(breaks, reverse=True)
    assert breaks[-1] < _SIZE / 2 and same(packed, tmp_path / "out")


def test_what_an_interrupted_fetch_left_is_continued(packed, server, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    data = (packed / "a-000000.tar").read_bytes()
    (out / "a-000000.tar.part").write_bytes(data[:600_000])
    given = []

    def give(self, data):
        given.append((self.path, len(data)))
        self.wfile.write(data)

    fetch(source_of(server(handler(Handler, folder=packed, give=give))), out)
    assert ("/a-000000.tar", _SIZE - 600_000) in given and same(packed, out)


@pytest.mark.parametrize("left", [b"another version", b"x" * (_SIZE + 5)])
@pytest.mark.parametrize("ranges", [True, False])
def test_what_another_version_left_is_begun_again(packed, server, tmp_path, left, ranges):
    out = tmp_path / "out"
    out.mkdir()
    (out / "a-000000.tar.part").write_bytes(left)
    fetch(source_of(server(handler(Handler, folder=packed, ranges=ranges))), out)
    assert same(packed, out)


def test_a_server_that_gives_nothing_more_ends_in_a_line(packed, server, tmp_path, monkeypatch):
    monkeypatch.setattr(fetching, "_PAUSE_S", 0.0)

    def give(self, data):
        if "tar" not in self.path:
            self.wfile.write(data)
            return
        self.wfile.write(data[:1000] if len(data) == _SIZE else b"")
        self.connection.close()

    address = server(handler(Handler, folder=packed, give=give))
    with pytest.raises(WorkError, match="a-000000.tar: no bytes in 5 attempts.*continues"):
        fetch(source_of(address), tmp_path / "out")
    assert (tmp_path / "out/a-000000.tar.part").stat().st_size == 1000
    assert not (tmp_path / "out/a-000000.tar").exists()
    fetch(source_of(server(handler(Handler, folder=packed))), tmp_path / "out")
    assert same(packed, tmp_path / "out")


def changed_byte(self):
    data = bytearray((self.folder / self.path.strip("/")).read_bytes())
    if "tar" in self.path:
        data[500_000] ^= 1
    return bytes(data)


def more_bytes(self):
    return (self.folder / self.path.strip("/")).read_bytes() + b"more" * ("tar" in self.path)


def other_list(self):
    data = (self.folder / self.path.strip("/")).read_bytes()
    return data.replace(b"camera.json", b"../camera.json") if CHECKSUMS in self.path else data


def other_place(self):
    self.headers.replace_header("Range", "bytes=7-") if self.headers.get("Range") else None
    return (self.folder / self.path.strip("/")).read_bytes()


@pytest.mark.parametrize(
    ("lie", "words"),
    [
        (changed_byte, "its bytes are others"),
        (more_bytes, "its bytes are others"),
        (other_list, "SHA256SUMS:2: .*found .*../camera.json"),
        (other_place, "bytes from 100, found bytes from 7"),
    ],
)
def test_a_server_that_lies_is_refused_and_nothing_of_it_is_kept(
    packed, server, tmp_path, lie, words
):
    out = tmp_path / "out"
    out.mkdir()
    if lie is other_place:
        (out / "a-000000.tar.part").write_bytes(b"x" * 100)
    with pytest.raises(InputError, match=words) as error:
        fetch(source_of(server(handler(Handler, folder=packed, data=lie))), out)
    assert "\n" not in str(error.value)
    assert not (out / "a-000000.tar").exists() and not (tmp_path / "camera.json").exists()


def test_a_body_without_end_is_cut_off(packed, server, tmp_path, monkeypatch):
    monkeypatch.setattr(fetching, "MAX_SHARD_BYTES", _SIZE + 1000)

    def answer(self):
        if "tar" not in self.path:
            return Handler.do_GET(self)
        self.send_response(200)
        self.end_headers()
        with pytest.raises(OSError):  # until the other side closes
            while True:
                self.wfile.write(b"x" * 100_000)

    address = server(handler(Handler, folder=packed, do_GET=answer))
    with pytest.raises(InputError, match="a file of at most"):
        fetch(source_of(address), tmp_path / "out")
    assert not (tmp_path / "out/a-000000.tar").exists()


def test_the_digest_of_the_list_decides_what_is_fetched(packed, tmp_path, command_here):
    digest = hashlib.sha256((packed / CHECKSUMS).read_bytes()).hexdigest()
    assert command_here("fetch", packed, "-o", tmp_path / "a", "--sha256", digest)[0] == 0
    with open(packed / "camera.json", "ab") as file:
        file.write(b" ")
    sums = (packed / CHECKSUMS).read_text().splitlines()
    sums[1] = f"{hashlib.sha256(b'{} ').hexdigest()}  camera.json"
    (packed / CHECKSUMS).write_text("\n".join(sums) + "\n")
    code, _, said = command_here("fetch", packed, "-o", tmp_path / "b", "--sha256", digest)
    assert code == 2 and "SHA256SUMS with SHA-256" in said
    code, _, said = command_here("fetch", packed, "-o", tmp_path / "a")
    assert code == 2 and "try removing it" in said


def test_files_of_the_user_are_never_replaced(packed, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "camera.json").write_text("mine")
    with pytest.raises(InputError, match="camera.json: "):
        fetch(source_of(str(packed)), out)
    assert (out / "camera.json").read_text() == "mine"


@pytest.mark.parametrize(
    ("source", "words"),
    [("ftp://127.0.0.1/x", "http or https"), ("nowhere", "a folder or an address")],
)
def test_other_sources_are_refused(source, words, command_here):
    code, _, said = command_here("fetch", source)
    assert code == 2 and words in said and said.count("\n") == 1


def test_a_folder_without_a_list_is_refused(tmp_path, server, command_here):
    (tmp_path / "empty").mkdir()
    address = server(handler(Handler, folder=tmp_path / "empty"))
    for source in (tmp_path / "empty", address):
        code, _, said = command_here("fetch", source, "-o", tmp_path / "out")
        assert code == 2 and CHECKSUMS in said and said.count("\n") == 1


def test_members_outside_the_folder_are_not_unpacked(tmp_path):
    import io
    import tarfile

    for name, kind in (("../evil", tarfile.REGTYPE), ("link", tarfile.SYMTYPE)):
        out = tmp_path / kind.decode()
        out.mkdir()
        with tarfile.open(out / "a.tar", "w") as tar:
            info = tarfile.TarInfo(name)
            info.type, info.size, info.linkname = kind, 4 * (kind == tarfile.REGTYPE), "/etc/passwd"
            tar.addfile(info, io.BytesIO(b"evil"))
        with pytest.raises(InputError, match="plain files"):
            unpack(out)
    assert not (tmp_path / "evil").exists()


def test_a_kill_at_any_byte_is_resumed(packed, tmp_path, server):
    """The process ends while the server is giving: the next one continues."""
    import subprocess
    import sys
    import time

    def give(self, data):
        for start in range(0, len(data), 20_000):
            self.wfile.write(data[start : start + 20_000])
            if "tar" in self.path:
                time.sleep(0.02)

    address = server(handler(Handler, folder=packed, give=give))
    out = tmp_path / "out"
    command = [sys.executable, "-m", "iclnuim", "fetch", address, "-o", str(out), "--quiet"]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part = out / "a-000000.tar.part"
    for _ in range(600):
        if part.exists() and part.stat().st_size > 0:
            break
        time.sleep(0.1)
    child.kill()
    child.wait()
    left = part.stat().st_size if part.exists() else 0
    fast = server(handler(Handler, folder=packed))
    fetch(source_of(fast), out)
    assert left > 0 and same(packed, out)
