"""The environments pass Gymnasium's own checks, and many worlds are as many single ones."""

from pathlib import Path

import numpy as np
import pytest
import tilthex

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from tilthex import gym  # noqa: E402

CASES = [(task, action) for task in gym.TASKS for action in gym.ACTIONS]
SHORT = {"duration": 0.04, "period": 0.01}


def flown(env, seed, steps, action):
    """Observations, rewards and ends of an episode under one action after the other."""
    rows = [env.reset(seed=seed)[0]]
    for k in range(steps):
        observation, reward, ended, cut, _ = env.step(action[k])
        rows.append(np.concatenate([observation, [reward, ended, cut]]))
    return rows


@pytest.mark.parametrize(("task", "action"), CASES)
def test_gymnasium_accepts_it(task, action):
    check_env(gym.Flight(task, action=action, **SHORT), skip_render_check=True)


@pytest.mark.parametrize(("task", "action"), [CASES[k] for k in (1, 3, 6, 11)])
def test_many_worlds_are_single_ones_to_the_last_bit(task, action):
    name, count, seed = f"tilthex/{task.capitalize()}-v0", 3, 7
    many = gymnasium.make_vec(name, count, vectorization_mode="sync", action=action, **SHORT)
    singles = [gymnasium.make(name, action=action, **SHORT).unwrapped for _ in range(count)]
    draws = np.random.default_rng(1)
    found = [many.reset(seed=seed)[0]]
    asked = draws.uniform(-0.3, 0.3, (4, count, many.single_action_space.shape[0]))
    for k in range(4):
        observation, reward, ended, cut, _ = many.step(asked[k])
        found.append(np.column_stack([observation, reward, ended, cut]))
    for i, one in enumerate(singles):
        rows = flown(one, seed + i, 4, asked[:, i])
        assert all(np.array_equal(row, all_rows[i]) for row, all_rows in zip(rows, found, strict=True))
    assert not np.array_equal(found[0][0], found[0][1])
    assert cut.all() and not ended.any()


def test_a_seed_draws_the_episode_and_the_next_one_differs():
    env = gym.Flight("push", action="rotor_speeds", truth="cad", **SHORT)
    still = np.zeros((2, 6))
    first, second = flown(env, 3, 2, still), env.reset()[0]
    again = flown(env, 3, 2, still)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], second)


@pytest.mark.parametrize("task", ["hover", "push"])
def test_the_whole_controller_with_a_set_point_that_goes_to_the_goal_reaches_it(task):
    env = gym.Flight(task, truth="exact", duration=2.0)
    observation, info = env.reset(seed=2)
    begin, cut = info["position_error"], False
    while not cut:
        way = observation[:3] + env.unwrapped._tool() - env.unwrapped._place
        action = np.concatenate([np.clip(20 * way, -1, 1), np.zeros(3)])
        observation, reward, ended, cut, info = env.step(action)
        assert not ended and -1 <= reward <= 0 and env.observation_space.contains(observation)
    assert info["position_error"] < (0.02 if task == "hover" else 0.5) and begin > 0.02


def test_rotors_that_stop_end_the_episode_and_it_costs():
    env = gym.Flight("hover", action="rotor_speeds")
    env.reset(seed=1)
    total, ended, cut = 0.0, False, False
    while not (ended or cut):
        _, reward, ended, cut, _ = env.step(np.full(6, -1.0))
        total += reward
    assert ended and not cut and total < -8


def test_a_wall_of_a_hole_pushes_and_the_observer_feels_it():
    env = gym.Flight("slide", duration=2.0)
    env.reset(seed=5)
    down = np.array([0, 0, -1.0, 0, 0, 0])
    felt = [env.step(down) for _ in range(70)]
    force = np.array([info["contact_force"] for *_, info in felt])
    seen = np.array([observation[12:15] for observation, *_ in felt])
    assert force[0] == 0 and force[-10:].mean() > 0.3
    assert abs(np.linalg.norm(seen[-10:].mean(axis=0)) - force[-10:].mean()) < 0.5


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"task": "land"}, "task is 'land'; expected one of hover, push, slide, peg"),
        ({"action": "thrust"}, "action is 'thrust'; expected one of setpoint, wrench, rotor_speeds"),
        ({"period": 0.003}, "period is 0.003; expected a positive multiple of 0.002 s"),
        ({"duration": 0.0}, "duration is 0.0; expected at least the period, 0.02 s"),
    ],
)
def test_what_does_not_exist_is_refused(arguments, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}$"):
        gym.Flight(**arguments)


def test_another_vehicle_flies():
    config = tilthex.Config.default(tilthex.Vehicle.preset("omnidirectional-octorotor"))
    env = gym.Flight(config=config, action="wrench", truth="exact", **SHORT)
    assert env.reset(seed=1)[0].shape == (29,) and env.step(np.zeros(6))[0].shape == (29,)


def test_the_page_runs():
    page = Path(__file__).parent.parent / "docs/howto/gym.md"
    code = page.read_text().split("```python\n")[1].split("```")[0]
    names = {}
    exec(code, names)
    assert names["observations"].shape == (4, 27) and not names["truncated"]
