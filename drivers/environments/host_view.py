"""Which groups and flags the cameras of an environment show."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from evs.emulator.world import Visual, new_option

COLLISION, VISUAL = 0, 1
"""robosuite's groups of geoms"""


def find_visual(env: Any, camera: object = "") -> Visual | None:
    """The mjvOption of an environment's own pictures.

    Args:
        env: An environment, wrapped or not.
        camera: The name of the camera; dm_control's composer has an option for each.

    Returns:
        None where the environment has no option of its own: MuJoCo's defaults hold.
    """
    inner = getattr(env, "unwrapped", env)
    if hasattr(inner, "render_collision_mesh") and hasattr(inner, "render_visual_mesh"):
        return _of_robosuite(inner)
    renderer = getattr(inner, "mujoco_renderer", None)
    if renderer is not None:
        return _of_gymnasium(renderer)
    return _of_dm_control(env, camera)


def _of_robosuite(env: Any) -> Visual:
    context = getattr(getattr(env, "sim", None), "_render_context_offscreen", None)
    option: Any = new_option(getattr(context, "vopt", None))
    option.geomgroup[COLLISION] = bool(env.render_collision_mesh)
    option.geomgroup[VISUAL] = bool(env.render_visual_mesh)
    return option


def _of_gymnasium(renderer: Any) -> Visual | None:
    """Of a MujocoRenderer: Gymnasium, Gymnasium-Robotics, Metaworld."""
    viewers = [getattr(renderer, "viewer", None), *getattr(renderer, "_viewers", {}).values()]
    for viewer in viewers:
        if (option := getattr(viewer, "vopt", None)) is not None:
            return new_option(option)
    flags = getattr(renderer, "_vopt", None)
    if not flags:
        return None
    option = new_option(None)
    for flag, value in flags.items():
        option.flags[int(flag)] = value
    return option


def _of_dm_control(env: Any, camera: object) -> Visual | None:
    """Of a pixels.Wrapper around the environment, or of a composer's camera observables."""
    for layer in _layers(env):
        given = getattr(layer, "_render_kwargs", None)
        if isinstance(given, dict) and given.get("scene_option") is not None:
            return new_option(_plain(given["scene_option"]))
    found = {k: v for layer in _layers(env) for k, v in _camera_observables(layer).items()}
    option = found.get(str(camera))
    if option is None and len(found) == 1:
        (option,) = found.values()
    return None if option is None else new_option(_plain(option))


def _plain(option: Any) -> Any:
    """MuJoCo's option inside dm_control's wrapper around it."""
    return getattr(option, "ptr", option)


def _layers(env: Any) -> Iterator[Any]:
    """The environment, and those inside it, as wrappers of dm_control keep them."""
    seen = 0
    while env is not None and seen < 32:
        yield env
        inside = vars(env) if hasattr(env, "__dict__") else {}
        env, seen = inside.get("_env", inside.get("env")), seen + 1


def _camera_observables(env: Any) -> dict[str, Any]:
    """Name of each camera that a composer's environment observes with an option -> the option."""
    task = getattr(env, "task", None)
    root = getattr(task, "root_entity", None)
    entities: Callable[[], Any] | None = getattr(root, "iter_entities", None)
    if entities is None:
        return {}
    groups = [getattr(one, "observables", None) for one in entities()]
    every = [one for group in groups if group is not None for one in group.as_dict().values()]
    every += getattr(task, "task_observables", {}).values()
    return {
        str(one._mjcf_element.full_identifier): one.scene_option
        for one in every
        if getattr(one, "scene_option", None) is not None and one.enabled
    }
