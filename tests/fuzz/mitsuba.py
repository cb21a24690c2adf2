"""Mitsuba's XML files: damaged words, numbers and bytes of a scene that has most plugins, and of one that it includes."""

from __future__ import annotations

import math
from pathlib import Path
from random import Random

import numpy as np

import engines
from engines.scene import Mesh
from tests.fuzz.mutate import mutated_bytes, mutated_text

SCENE = """<?xml version="1.0" encoding="utf-8"?>
<scene version="3.0.0">
  <default name="r" value="0.5"/>
  <include filename="more.xml"/>
  <integrator type="path"><integer name="max_depth" value="6"/><integer name="rr_depth" value="3"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="40"/><string name="fov_axis" value="smaller"/><float name="near_clip" value="0.1"/>
    <transform name="to_world"><lookat origin="0, 1, 5" target="0 1 0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="tent"/></film>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
  </sensor>
  <shape type="obj">
    <string name="filename" value="m.obj"/><boolean name="face_normals" value="false"/>
    <bsdf type="mask"><float name="opacity" value="0.5"/><bsdf type="twosided"><ref id="board"/></bsdf></bsdf>
  </shape>
  <shape type="sphere">
    <float name="radius" value="$r"/><point name="center" x="1" y="0" z="0"/><ref id="metal"/>
    <transform name="to_world"><scale value="2"/><rotate x="1" angle="30"/><translate x="0.5"/></transform>
  </shape>
  <shape type="cube"><ref id="glass"/>
    <transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0.5 0 0 0 1"/></transform></shape>
  <shape type="rectangle"><emitter type="area"><rgb name="radiance" value="1,2,3"/></emitter></shape>
  <shape type="disk"><boolean name="flip_normals" value="true"/>
    <bsdf type="blendbsdf"><float name="weight" value="0.3"/><ref id="metal"/><bsdf type="plastic"/></bsdf></shape>
  <shape type="cylinder"><point name="p1" value="0 2 1"/>
    <bsdf type="principled"><float name="metallic" value="0.5"/></bsdf></shape>
  <emitter type="envmap"><string name="filename" value="t.png"/>
    <transform name="to_world"><rotate y="1" angle="9"/></transform></emitter>
  <emitter type="spot"><float name="cutoff_angle" value="30"/><spectrum name="intensity" value="400:1, 500:2"/>
    <texture name="texture" type="bitmap"><string name="filename" value="t.png"/></texture></emitter>
  <emitter type="projector"><float name="fov" value="30"/><float name="scale" value="2"/>
    <texture name="irradiance" type="checkerboard"/></emitter>
</scene>
"""
MORE = """<scene version="0.5.0">
  <bsdf type="roughconductor" id="metal"><string name="material" value="Au"/><float name="alphaU" value="0.2"/></bsdf>
  <bsdf type="dielectric" id="glass"><float name="intIOR" value="1.5"/><string name="extIOR" value="air"/></bsdf>
  <bsdf type="diffuse" id="board">
    <texture type="checkerboard" name="reflectance"><float name="uscale" value="8"/></texture></bsdf>
  <bsdf type="bumpmap" id="bump">
    <texture type="bitmap"><string name="filename" value="t.png"/></texture><ref id="board"/></bsdf>
</scene>
"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/2 4/3\n"


def write(random: Random, folder: Path) -> None:
    """A folder with `s.xml` and the files that it names, one of which is damaged."""
    from PIL import Image

    files = {"s.xml": SCENE, "more.xml": MORE}
    name = random.choice(("s.xml", "s.xml", "more.xml"))
    content = files[name].encode()
    damaged = mutated_text(random, content.decode()).encode() if random.random() < 0.7 else mutated_bytes(random, content)
    for other, text in files.items():
        (folder / other).write_bytes(damaged if other == name else text.encode())
    (folder / "m.obj").write_text(OBJ, encoding="ascii")
    Image.fromarray(np.arange(12, dtype=np.uint8).reshape(2, 2, 3) * 20).save(folder / "t.png")


def read(folder: Path) -> None:
    """Loads; every number must be finite, and every material there."""
    scene = engines.load_scene(folder / "s.xml")
    assert all(map(math.isfinite, (*scene.camera.eye, *scene.camera.target, *scene.camera.up)))
    for shape in scene.shapes:
        if isinstance(shape, Mesh):
            assert np.isfinite(shape.vertices).all() and (shape.normals is None or np.isfinite(shape.normals).all())
            assert shape.faces.min() >= 0 and shape.faces.max() < len(shape.vertices)
        assert np.isfinite(shape.bounds()).all()
