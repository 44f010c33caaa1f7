"""docs/schema: what it says of the control socket's lines is what a flight says."""

import copy
import json
import socket
import threading
from pathlib import Path

import jsonschema
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from referencing import Registry, Resource
from test_control_socket import connected, say
from test_programs import control_port, started
from tilthex.client import PROTOCOL

pytestmark = pytest.mark.real_time

SCHEMA = Path(__file__).parents[1] / "docs" / "schema"
CONTENTS = {path.name: json.loads(path.read_text()) for path in SCHEMA.glob("*.json")}
REGISTRY = Registry().with_resources(
    (name, Resource.from_contents(content)) for name, content in CONTENTS.items()
)
ORDERS, STATE, ANSWERS = (
    jsonschema.Draft202012Validator(CONTENTS[f"{name}.json"], registry=REGISTRY)
    for name in ("orders", "state", "answers")
)
LEVEL = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
GOOD = [
    {"command": "follow", "position": [0, 0, 1], "rotation": LEVEL, "wrench": {"force": [1, 0, 0]}},
    {
        "command": "play",
        "waypoint": [{"position": [0, 0, 1], "yaw_pitch_roll_deg": [9, 0, 0], "hold": 1}],
        "limits": {"velocity": 0.2},
    },
    {"command": "set_wrench", "force": [1, 0, 0], "torque": [0, 0, 0]},
    {"command": "set_admittance", "stiffness": [6, 6, 6, 10, 10, 5], "max_translation": 0.5},
    {"command": "zero_bias"},
    {"command": "release_wrench"},
    {"command": "configuration"},
]
MALFORMED = ("invalid type", "invalid length", "missing field", "unknown field", "expected", "unknown key")
WRONG = (None, "1", True, [], [1, 2], {}, {"x": 1}, [["a"]], 7)


@pytest.fixture(scope="module")
def port():
    with started("--sim", "--control", "127.0.0.1:0") as process:
        yield control_port(process)
        process.terminate()
        process.wait(10)


def places(value, path=()):
    """The ways to everything inside an order."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inside in items:
        yield from places(inside, (*path, key))


@st.composite
def changed(draw):
    """An order with one thing in it missing, too much or of another kind."""
    order = copy.deepcopy(draw(st.sampled_from(GOOD)))
    *way, last = draw(st.sampled_from([p for p in places(order) if p != ("command",)] or [("more",)]))
    inner = order
    for key in way:
        inner = inner[key]
    act = draw(st.sampled_from(("drop", "replace", "add")))
    if act == "drop" and last != "more":
        del inner[last]
    elif act == "replace" or isinstance(inner, list):
        inner[last if last != "more" else "unknown"] = draw(st.sampled_from(WRONG))
    else:
        inner["unknown"] = 1
    return order


def test_orders_of_the_documentation_are_of_the_schema(port):
    for order in GOOD:
        ORDERS.validate(order | {"id": 1})
        with connected(port) as client:
            answer = say(client, **order)
        ANSWERS.validate(answer)
        error = answer.get("error", "")
        assert not any(word in error for word in MALFORMED), error


@given(changed())
def test_what_the_schema_refuses_the_flight_refuses(port, order):
    if not ORDERS.is_valid(order):
        with connected(port) as client:
            answer = say(client, **order)
        ANSWERS.validate(answer)
        assert "error" in answer, order


def test_the_state_is_of_the_schema(port):
    with connected(port) as client:
        STATE.validate(say(client, command="state")["state"])


def test_answers_tell_the_version_of_the_schema(port):
    with connected(port) as client:
        answer = say(client, command="state")
        ANSWERS.validate(answer)
        assert answer["protocol"] == PROTOCOL
        assert not ANSWERS.is_valid(answer | {"protocol": PROTOCOL + 1})
        client.sendall(b'{"command": "stream", "rate": 50}\n')
        with client.makefile("r", encoding="utf-8") as lines:
            for line, _ in zip(lines, range(3), strict=False):
                ANSWERS.validate(json.loads(line))


@pytest.mark.parametrize(
    ("told", "version"),
    [({}, "an older version"), ({"protocol": PROTOCOL + 1}, f"version {PROTOCOL + 1}")],
)
def test_a_client_refuses_another_version_with_one_sentence(told, version):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection, connection.makefile("rw", encoding="utf-8") as lines:
                request = json.loads(lines.readline())
                lines.write(json.dumps({"id": request["id"], "ok": True, "state": None} | told) + "\n")

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(
            ConnectionError, match=f"speaks {version} of the control protocol; expected {PROTOCOL}: "
        ):
            tilthex.connect(port=server.getsockname()[1])
        thread.join()
