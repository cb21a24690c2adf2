"""The table of the fields of models: it has every field of every model, and the keys and parameters that it names exist."""

from dataclasses import fields
from typing import get_args

import numpy as np
import pytest

from engines.peers.mitsuba.bsdfs import bsdf_node, material_lacks
from engines.peers.mitsuba.nodes import Placing
from engines.peers.mitsuba.textures import Textures
from engines.scene import Checkerboard, Conductor, CustomBSDF, Dielectric, Material, Mixture, Plastic, Principled
from engines.scene.leaf_fields import LEAF_PLUGINS, is_rough
from engines.scene.mitsuba_xml.bsdfs import BSDFS, REFUSED
from engines.scene.models import LEAVES, Leaf
from tests import bsdf_parameter_sets as sets


def test_every_model_has_every_field():
    assert set(LEAF_PLUGINS) == {*get_args(Leaf)} - {Mixture, CustomBSDF}
    for model, plugin in LEAF_PLUGINS.items():
        assert {item.name for item in plugin.fields} == {item.name for item in fields(model)}


def test_every_key_is_one_of_scene_files():
    for plugin in LEAF_PLUGINS.values():
        record = LEAVES[plugin.key]
        assert {plugin.key_of(item.name) for item in plugin.fields} <= set(getattr(record, "keys", {}))


def test_every_plugin_of_a_model_is_read():
    named = {name for plugin in LEAF_PLUGINS.values() for name in (plugin.plugin, plugin.rough) if name}
    assert named <= set(BSDFS) and not named & set(REFUSED)


@pytest.mark.parametrize(
    ("leaf", "rough"),
    [
        (Conductor((0.2,) * 3, (3.0,) * 3), False),
        (Conductor((0.2,) * 3, (3.0,) * 3, (0.1, 0.1)), True),
        (Dielectric(alpha=(Checkerboard(), Checkerboard())), True),
        (Plastic(alpha=0.2), True),
        (Plastic(), False),
        (Principled(), False),
    ],
)
def test_microfacets_choose_the_plugin_and_its_parameters(leaf, rough):
    plugin = LEAF_PLUGINS[type(leaf)]
    assert is_rough(leaf) == rough
    assert plugin.plugin_of(leaf) == (plugin.rough if rough else plugin.plugin)
    written = {item.name for item in plugin.fields_of(plugin.plugin_of(leaf))}
    assert ("alpha" in written) == ("distribution" in written) == rough


def test_no_two_fields_of_a_model_share_a_parameter_in_mitsuba():
    ours = {kind for kind, plugin in LEAF_PLUGINS.items() if plugin.plugin}
    leaves = [leaf for each in vars(sets).values() if isinstance(each, list) for leaf in each if type(leaf) in ours]
    for leaf in leaves:
        assert material_lacks(Material("m", bsdf=leaf)) is None
        node = bsdf_node(leaf, Textures(Placing(lambda *_: "", lambda *_: {})))
        inner = node.get("bsdf", node)
        plugin = LEAF_PLUGINS[type(leaf)]
        several = {"alpha": 1, "ior": 1} if isinstance(leaf, Conductor | Dielectric) else {"ior": 1}
        count = sum(1 + several.get(item.name, 0) for item in plugin.fields_of(inner["type"]))
        assert len(inner) == 1 + count
    assert np.size(leaves) > 50
