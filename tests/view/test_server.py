"""The server without a browser: refused requests, floods, crashes, and closed tabs."""

import asyncio
import http.client
import time

import psutil
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from harness.cli import main
from harness.view.render_slots import MAX_RENDERS, MAX_TABS, RenderSlots
from tests.view.tab import Tab
from tests.view.viewer_process import Viewer

SETTINGS = {
    "engine": "numpy",
    "shader": {"name": "path_tracer", "max_depth": 4},
    "sampler": {"name": "sobol"},
    "accelerator": {"name": "auto"},
    "threads": 1,
}
ENDLESS = {"type": "open", "scene": "ball.yaml", "settings": SETTINGS, "spp": 1_000_000}


def get(viewer, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=300)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for key, value in headers.items():
        connection.putheader(key, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


def workers(viewer):
    return [child for child in psutil.Process(viewer.pid).children() if is_alive(child)]


def is_alive(process):
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:  # it ended since it was listed
        return False


# ---- access ---------------------------------------------------------------------------------------------------


def test_pages_have_a_content_security_policy(viewer):
    status, body, headers = get(viewer, f"/{viewer.token}/")
    assert status == 200 and b'data-scene="ball.yaml"' in body
    assert "default-src 'none'" in headers["content-security-policy"] and headers["referrer-policy"] == "no-referrer"


def test_it_listens_on_the_loopback_address_alone(viewer):
    listening = [c.laddr.ip for c in psutil.Process(viewer.pid).net_connections() if c.status == psutil.CONN_LISTEN]
    assert listening == ["127.0.0.1"]


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:80", ""])
def test_another_host_is_refused(viewer, host):
    assert get(viewer, f"/{viewer.token}/", Host=host)[0] in (400, 403)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{}", "http://127.0.0.1"])
def test_another_origin_is_refused(viewer, origin):
    assert get(viewer, f"/{viewer.token}/", Origin=origin.format(viewer.port))[0] == 403
    with pytest.raises(InvalidStatus):
        Tab(viewer, Origin=origin.format(viewer.port))


def test_a_socket_without_an_origin_is_refused(viewer):
    with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{viewer.port}/{viewer.token}/socket/view"):
        pass


@pytest.mark.parametrize(
    "change", [lambda t: "", lambda t: t[:-1], lambda t: t + "x", lambda t: "A" * len(t), lambda t: t.swapcase()]
)
def test_another_token_is_refused(viewer, change):
    status, body, _ = get(viewer, f"/{change(viewer.token)}/view.html")
    assert status == 403 and viewer.token.encode() not in body


@pytest.mark.parametrize(
    "path",
    [
        "../view.html",
        "%2e%2e/%2e%2e/etc/passwd",
        "..%2f..%2fetc%2fpasswd",
        "page/../../server.py",
        "server.py",
        "/etc/passwd",
        "reports/../report.html",
        "reports/..%2f..%2fetc/report.html",
        "reports/%2e%2e/report.html",
        "view.html%00",
    ],
)
def test_no_path_leads_out(viewer, path):
    status, body, _ = get(viewer, f"/{viewer.token}/{path}")
    assert status in (403, 404) and b"root:" not in body and b"import" not in body


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing"], "unknown scene"),
        (["--folder", "nowhere"], "is not a folder"),
        (["--engine", "nume"], "did you mean 'numpy'"),
        (["deep/other.yaml", "--folder", "results"], "--folder"),
    ],
)
def test_wrong_options_are_refused_before_anything_starts(folder, monkeypatch, capsys, arguments, words):
    (folder / "results").mkdir(exist_ok=True)
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.argv", ["raybench", "view", "--no-browser", *arguments])
    monkeypatch.setattr("uvicorn.Server.serve", None)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2 and words in capsys.readouterr().err


# ---- requests ----------------------------------------------------------------------------------------------


def test_invalid_requests_are_answered_and_change_nothing(viewer):
    with Tab(viewer) as tab:
        camera = '{"type": "camera", "eye": [1e999, 0, 0]}'
        for text in ("", "[]", "{", '{"type": 1}', "null", '{"type": "open"}', camera, '{"type": "x"}'):
            tab.socket.send(text)
            tab.receive(lambda header: header["type"] == "error")
        tab.send(**{**ENDLESS, "width": 4096, "height": 4096})
        assert "pixels" in tab.receive(lambda header: header["type"] == "error")["text"]
        tab.send(**{**ENDLESS, "settings": {**SETTINGS, "engine": "os:system"}})
        assert "--allow-imports" in tab.receive(lambda header: header["type"] == "error")["text"]
        tab.send(**{**ENDLESS, "spp": 1})
        assert tab.state("finished")["spp"] == 1


def test_a_shader_that_leaves_out_the_media_of_a_scene_is_warned_of(viewer, folder):
    foggy = (folder / "ball.yaml").read_text().replace("resolution:", "medium: fog, resolution:")
    (folder / "fog.yaml").write_text(foggy + "media: {fog: {sigma_t: 1, albedo: 0.5}}\n")
    with Tab(viewer) as tab:
        told = []
        for shader in ("path_tracer", "volumetric_path_tracer"):
            tab.send(**{**ENDLESS, "scene": "fog.yaml", "spp": 1, "settings": {**SETTINGS, "shader": {"name": shader}}})
            tab.receive(lambda header: told.append(header) or header["type"] == "opened")
        warnings = [header["text"] for header in told if header["type"] == "warning"]
        assert warnings == ["path_tracer leaves out the media of the scene; volumetric_path_tracer renders them"]


def test_a_scene_outside_the_folder_is_refused(viewer, folder, tmp_path):
    (tmp_path / "secret.yaml").write_text((folder / "ball.yaml").read_text())
    (folder / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    with Tab(viewer) as tab:
        for name in ("../../etc/passwd", "/etc/passwd", "link.yaml", "\0", "a" * 299, "no.yaml"):
            tab.send(**{**ENDLESS, "scene": name})
            answer = tab.receive(lambda header: header["type"] in ("error", "opened", "frame"))
            assert answer["type"] == "error", name


def test_a_flood_keeps_neither_the_server_nor_another_tab_from_answering(viewer):
    with Tab(viewer) as noisy, Tab(viewer) as calm:
        noisy.send(**ENDLESS)
        noisy.state("busy")
        for index in range(3000):
            noisy.send(type="camera", eye=[0, 1, 5 + index * 1e-4], target=[0, 1, 0], up=[0, 1, 0])
        assert get(viewer, f"/{viewer.token}/")[0] == 200
        calm.send(**{**ENDLESS, "spp": 1})
        calm.state("finished")


def test_the_server_answers_during_a_render(viewer):
    """The render has no end: a server that waited for it would never answer. tests/benchmarks/view.py measures latencies."""
    with Tab(viewer) as tab:
        tab.send(**{**ENDLESS, "width": 512, "height": 384})
        tab.state("busy")
        for _ in range(10):
            assert tab.socket.ping().wait(300)
            assert get(viewer, f"/{viewer.token}/")[0] == 200
        assert tab.state("busy", "finished", "stopped")["state"] == "busy"


# ---- tabs ------------------------------------------------------------------------------------------------------------


def test_a_closed_tab_ends_its_render(viewer):
    before = {worker.pid for worker in workers(viewer)}
    with Tab(viewer) as tab:
        tab.send(**ENDLESS)
        tab.state("busy")
        running = {worker.pid for worker in workers(viewer)}
    end = time.monotonic() + 300
    while time.monotonic() < end and len(workers(viewer)) > max(1, len(before)):
        time.sleep(0.05)
    assert len(running) >= 2 and len(workers(viewer)) <= max(1, len(before))


def test_of_many_tabs_some_wait_for_a_render_slot_and_too_many_are_refused(viewer):
    tabs = []
    try:
        tabs.extend(Tab(viewer) for _ in range(MAX_TABS))
        with Tab(viewer) as last:
            assert "pages are already open" in last.receive(lambda header: header["type"] == "error")["text"]
        for tab in tabs:
            tab.send(**ENDLESS)
        states = [tab.state("busy", "waiting") for tab in tabs]
        waiting = [state for state in states if state["state"] == "waiting"]
        assert len(waiting) == MAX_TABS - MAX_RENDERS and "waits for them" in waiting[0]["activity"]
        assert get(viewer, f"/{viewer.token}/")[0] == 200
        first = next(tab for tab, state in zip(tabs, states, strict=True) if state["state"] == "busy")
        first.send(type="stop")
        first.state("stopped")
        late = next(tab for tab, state in zip(tabs, states, strict=True) if state["state"] == "waiting")
        late.state("busy")
    finally:
        for tab in tabs:
            tab.close()


CRASHES = """
import os, signal, time
import numpy as np
import engines
from engines.interface import Hits

class Renderer:
    def __init__(self, how, width, height):
        self.how, self.film = how, engines.Film(width, height)
    def warm_up(self): pass
    def render(self, spp, on_pass=None):
        if self.how == "dies" and self.film.width > 20: os.kill(os.getpid(), signal.SIGSEGV)
        while self.how == "deaf" and self.film.width > 20: time.sleep(0.01)
        self.film.add(np.full((self.film.height, self.film.width, 3), 0.5))
        return self.film
    def stop(self): pass
    def update(self, camera=None, shapes=None): self.film.clear()
    def trace(self, o, d, t=1): raise RuntimeError("no rays")
    def occluded(self, o, d, t=1): raise RuntimeError("no rays")
    def counters(self): return {"rays": 0}

class Dies:
    name = version = how = "dies"
    def accelerators(self): return {"auto": {}}
    def why_not(self, scene, settings): return None
    def prepare(self, scene, settings): return Renderer(self.how, *settings.size(scene))

class Deaf(Dies):
    how = "deaf"
"""


def test_a_render_that_crashes_or_does_not_stop_ends_only_its_worker(folder):
    (folder / "crashes.py").write_text(CRASHES)
    with Viewer(folder, "ball.yaml", "--allow-imports") as viewer, Tab(viewer) as tab:
        tab.send(**{**ENDLESS, "settings": {**SETTINGS, "engine": "crashes:Dies"}})
        assert "SIGSEGV" in tab.receive(lambda header: header["type"] == "worker_lost")["text"]
        tab.send(**{**ENDLESS, "settings": {**SETTINGS, "engine": "crashes:Deaf"}})
        tab.state("busy")
        time.sleep(0.5)
        tab.send(type="stop")
        assert "did not stop" in tab.receive(lambda header: header["type"] == "worker_lost")["text"]
        tab.send(**{**ENDLESS, "spp": 1})
        assert tab.state("finished")["spp"] == 1


def test_render_slots_are_given_in_the_order_of_requests():
    async def scene():
        slots, order = RenderSlots(1), []

        async def tab(name):
            if await slots.acquire(name):
                order.append(name)

        waiting = []
        for name in "abcd":
            waiting.append(asyncio.create_task(tab(name)))
            await asyncio.sleep(0)
        assert order == ["a"] and not slots.is_free_for("b")
        slots.cancel("b")
        slots.release("a")
        await asyncio.sleep(0)
        assert order == ["a", "c"] and slots.in_use == 1
        slots.release("c")
        await asyncio.gather(*waiting)
        assert order == ["a", "c", "d"]

    asyncio.run(scene())


RACE = {
    "type": "race",
    "scene": "ball.yaml",
    "contestants": [SETTINGS, {**SETTINGS, "sampler": {"name": "random"}}],
    "width": 48,
    "height": 36,
    "targets": [1e-9],
    "reference_engine": "numpy",
    "max_seconds": 60,
}


def test_a_race_is_stopped_at_any_time_and_leaves_nothing_behind(viewer, folder):
    scratch = list((folder / "results").glob(".race-*")) if (folder / "results").is_dir() else []
    with Tab(viewer, page="race") as tab:
        tab.send(**RACE, reference_spp=100_000)
        tab.receive(lambda header: header["type"] == "progress")
        tab.send(type="stop")
        tab.state("stopped")
        tab.send(type="save", name="early")
        assert "no race" in tab.receive(lambda header: header["type"] == "error")["text"]
        tab.send(**RACE, reference_spp=8)
        tab.receive(lambda header: header["type"] == "contestant" and header["points"])
        tab.send(type="stop")
        tab.state("stopped")
        tab.send(**{**RACE, "contestants": [SETTINGS, SETTINGS]}, reference_spp=8)
        assert "same settings" in tab.receive(lambda header: header["type"] == "error")["text"]
        assert len(list((folder / "results").glob(".race-*"))) >= len(scratch)
    end = time.monotonic() + 300
    while time.monotonic() < end and len(list((folder / "results").glob(".race-*"))) > len(scratch):
        time.sleep(0.05)
    assert list((folder / "results").glob(".race-*")) == scratch
    assert not (folder / "results/early").exists()
