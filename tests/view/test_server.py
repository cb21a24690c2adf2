"""The server without a browser: who is refused, what a flood and a crash do, and what a closed tab leaves behind."""

import asyncio
import http.client
import time

import psutil
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from harness.cli import main
from harness.view.turns import MOST_RENDERS, MOST_TABS, Turns
from tests.view.driving import Viewer
from tests.view.tab import Tab

PART = {"engine": "numpy", "shader": {"name": "path_tracer", "max_depth": 4}, "sampler": {"name": "sobol"},
        "accelerator": {"name": "auto"}, "threads": 1}  # fmt: skip
ENDLESS = {"do": "open", "scene": "ball.yaml", "part": PART, "spp": 1_000_000}


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


# ---- who may speak ---------------------------------------------------------------------------------------------------


def test_pages_come_with_a_policy_that_lets_nothing_else_in(viewer):
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
    with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{viewer.port}/{viewer.token}/desk/view"):
        pass


@pytest.mark.parametrize(
    "change", [lambda t: "", lambda t: t[:-1], lambda t: t + "x", lambda t: "A" * len(t), lambda t: t.swapcase()]
)
def test_another_token_is_refused(viewer, change):
    status, body, _ = get(viewer, f"/{change(viewer.token)}/view.html")
    assert status == 403 and viewer.token.encode() not in body


@pytest.mark.parametrize("path", [
    "../view.html", "%2e%2e/%2e%2e/etc/passwd", "..%2f..%2fetc%2fpasswd", "page/../../server.py", "server.py", "/etc/passwd",
    "reports/../report.html", "reports/..%2f..%2fetc/report.html", "reports/%2e%2e/report.html", "view.html%00",
])  # fmt: skip
def test_no_path_leads_out(viewer, path):
    status, body, _ = get(viewer, f"/{viewer.token}/{path}")
    assert status in (403, 404) and b"root:" not in body and b"import" not in body


@pytest.mark.parametrize(("arguments", "words"), [
    (["nothing"], "unknown scene"), (["--folder", "nowhere"], "is no folder"), (["--engine", "nume"], "did you mean 'numpy'"),
    (["deep/other.yaml", "--folder", "results"], "--folder"),
])  # fmt: skip
def test_what_cannot_be_served_is_said_before_anything_starts(folder, monkeypatch, capsys, arguments, words):
    (folder / "results").mkdir(exist_ok=True)
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.argv", ["raybench", "view", "--no-browser", *arguments])
    monkeypatch.setattr("uvicorn.Server.serve", None)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2 and words in capsys.readouterr().err


# ---- what pages may ask ----------------------------------------------------------------------------------------------


def test_nonsense_is_answered_and_changes_nothing(viewer):
    with Tab(viewer) as tab:
        wrong = ("", "[]", "{", '{"do": 1}', "null", '{"do": "open"}', '{"do": "camera", "eye": [1e999, 0, 0]}', '{"do": "x"}')
        for text in wrong:
            tab.socket.send(text)
            tab.hear(lambda told: told["is"] == "problem")
        tab.send(**{**ENDLESS, "width": 4096, "height": 4096})
        assert "pixels" in tab.hear(lambda told: told["is"] == "problem")["text"]
        tab.send(**{**ENDLESS, "part": {**PART, "engine": "os:system"}})
        assert "--allow-imports" in tab.hear(lambda told: told["is"] == "problem")["text"]
        tab.send(**{**ENDLESS, "spp": 1})
        assert tab.state("finished")["spp"] == 1


@pytest.mark.parametrize("name", ["../../etc/passwd", "/etc/passwd", "link.yaml", "\0", "a" * 299, "no.yaml"])
def test_a_scene_outside_the_folder_is_refused(viewer, folder, tmp_path, name):
    if name == "link.yaml":
        (tmp_path / "secret.yaml").write_text((folder / "ball.yaml").read_text())
        (folder / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    with Tab(viewer) as tab:
        tab.send(**{**ENDLESS, "scene": name})
        assert tab.hear(lambda told: told["is"] in ("problem", "opened"))["is"] == "problem"


def test_a_flood_keeps_neither_the_server_nor_another_tab_from_answering(viewer):
    with Tab(viewer) as noisy, Tab(viewer) as calm:
        noisy.send(**ENDLESS)
        noisy.state("busy")
        for index in range(3000):
            noisy.send(do="camera", eye=[0, 1, 5 + index * 1e-4], target=[0, 1, 0], up=[0, 1, 0])
        assert get(viewer, f"/{viewer.token}/")[0] == 200
        calm.send(**{**ENDLESS, "spp": 1})
        calm.state("finished")


def test_the_server_answers_within_50_ms_while_it_renders(viewer):
    with Tab(viewer) as tab:
        tab.send(**{**ENDLESS, "width": 512, "height": 384})
        tab.state("busy")
        waits = []
        for _ in range(40):
            start = time.monotonic()
            assert tab.socket.ping().wait(300)
            waits.append(time.monotonic() - start)
            time.sleep(0.02)
    assert sorted(waits)[10] < 0.05  # a server that waits for its renders is late every time, a busy machine now and then


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


def test_ten_tabs_render_in_turn_and_say_so(viewer):
    tabs = [Tab(viewer) for _ in range(10)]
    try:
        for tab in tabs:
            tab.send(**ENDLESS)
        told = [tab.state("busy", "waiting") for tab in tabs]
        waiting = [state for state in told if state["state"] == "waiting"]
        assert len(waiting) == 10 - MOST_RENDERS and "waits for its turn" in waiting[0]["doing"]
        assert get(viewer, f"/{viewer.token}/")[0] == 200
        first = next(tab for tab, state in zip(tabs, told, strict=True) if state["state"] == "busy")
        first.send(do="stop")
        first.state("stopped")
        late = next(tab for tab, state in zip(tabs, told, strict=True) if state["state"] == "waiting")
        late.state("busy")
    finally:
        for tab in tabs:
            tab.close()


def test_more_tabs_than_are_allowed_are_told_so(viewer):
    tabs = []
    try:
        tabs.extend(Tab(viewer) for _ in range(MOST_TABS))
        with Tab(viewer) as last:
            assert "pages are open already" in last.hear(lambda told: told["is"] == "problem")["text"]
    finally:
        for tab in tabs:
            tab.close()


CRASHES = '''
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
'''


def test_a_render_that_crashes_or_does_not_stop_ends_alone(folder):
    (folder / "crashes.py").write_text(CRASHES)
    with Viewer(folder, "ball.yaml", "--allow-imports") as viewer, Tab(viewer) as tab:
        tab.send(**{**ENDLESS, "part": {**PART, "engine": "crashes:Dies"}})
        assert "SIGSEGV" in tab.hear(lambda told: told["is"] == "lost")["text"]
        tab.send(**{**ENDLESS, "part": {**PART, "engine": "crashes:Deaf"}})
        tab.state("busy")
        time.sleep(0.5)
        tab.send(do="stop")
        assert "did not stop" in tab.hear(lambda told: told["is"] == "lost")["text"]
        tab.send(**{**ENDLESS, "spp": 1})
        assert tab.state("finished")["spp"] == 1


def test_turns_are_given_in_the_order_of_asking():
    async def scene():
        turns, order = Turns(1), []

        async def tab(name):
            if await turns.acquire(name):
                order.append(name)

        waiting = []
        for name in "abcd":
            waiting.append(asyncio.create_task(tab(name)))
            await asyncio.sleep(0)
        assert order == ["a"] and not turns.free_for("b")
        turns.give_up("b")
        turns.release("a")
        await asyncio.sleep(0)
        assert order == ["a", "c"] and turns.rendering == 1
        turns.release("c")
        await asyncio.gather(*waiting)
        assert order == ["a", "c", "d"]

    asyncio.run(scene())


RACE = {"do": "race", "scene": "ball.yaml", "lanes": [PART, {**PART, "sampler": {"name": "random"}}], "width": 48, "height": 36,
        "targets": [1e-9], "reference_engine": "numpy", "max_seconds": 60}  # fmt: skip


def test_a_race_is_stopped_at_any_time_and_leaves_nothing_behind(viewer, folder):
    scratch = list((folder / "results").glob(".race-*")) if (folder / "results").is_dir() else []
    with Tab(viewer, desk="race") as tab:
        tab.send(**RACE, reference_spp=100_000)
        tab.hear(lambda told: told["is"] == "progress")
        tab.send(do="stop")
        tab.state("stopped")
        tab.send(do="save", name="early")
        assert "no race" in tab.hear(lambda told: told["is"] == "problem")["text"]
        tab.send(**RACE, reference_spp=8)
        tab.hear(lambda told: told["is"] == "lane" and told["points"])
        tab.send(do="stop")
        tab.state("stopped")
        tab.send(**{**RACE, "lanes": [PART, PART]}, reference_spp=8)
        assert "same settings" in tab.hear(lambda told: told["is"] == "problem")["text"]
        assert len(list((folder / "results").glob(".race-*"))) >= len(scratch)
    end = time.monotonic() + 300
    while time.monotonic() < end and len(list((folder / "results").glob(".race-*"))) > len(scratch):
        time.sleep(0.05)
    assert list((folder / "results").glob(".race-*")) == scratch
    assert not (folder / "results/early").exists()
