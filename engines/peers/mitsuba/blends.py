"""A blend of a smooth and a specular BSDF for the wavefront, since Mitsuba's own, `blendbsdf`, is biased (3.8.0 and 3.9.1).

After sampling one of its two BSDFs, `blendbsdf` evaluates the other in the sampled direction, and divides the sum of both
values by the sum of both densities. The density of a mirror or of smooth glass is given as 1, a probability, and not one per
solid angle: reflections are tinted by the diffuse lobe wherever the two have different colours. A specular sample must keep
its own weight.
"""

from __future__ import annotations

from typing import Any

from engines.peers.mitsuba.nodes import Node

NAME = "raybench_blend"
SPECULAR = ("conductor", "dielectric", "thindielectric", "null")
_registered: set[str] = set()


def _kinds(node: Node) -> set[bool]:
    """Whether the lobes of a BSDF are specular."""
    inner = [value for key, value in node.items() if key.startswith("bsdf")]
    own = {"plastic": {True, False}, "mask": {True}}.get(node["type"], set() if inner else {node["type"] in SPECULAR})
    return own.union(*map(_kinds, inner))


def exact(node: Any) -> Any:
    """The nodes, with every blend of smooth and specular lobes by the plugin that `register` makes known."""
    if not isinstance(node, dict):
        return node
    inner = {key: exact(value) for key, value in node.items()}
    return {**inner, "type": NAME} if node.get("type") == "blendbsdf" and len(_kinds(node)) == 2 else inner


def register(mi: Any, dr: Any) -> None:
    """Makes the plugin `raybench_blend` known to the active variant. It has the parameters of `blendbsdf`."""
    if mi.variant() in _registered:
        return
    _registered.add(mi.variant())

    class Blend(mi.BSDF):
        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.weight = props.get_texture("weight")
            self.parts = [props[name] for name in ("bsdf_0", "bsdf_1")]
            self.m_components = [part.flags(k) for part in self.parts for k in range(part.component_count())]
            self.m_flags = self.parts[0].flags() | self.parts[1].flags()

        def shares(self, si: Any, active: Any) -> tuple[Any, Any]:
            share = dr.clip(self.weight.eval_1(si, active), 0.0, 1.0)
            return 1.0 - share, share

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            first, second = self.shares(si, active)
            taken = sample1 < second  # strictly: of a share of 0 nothing is taken
            numbers = (sample1 - second) / first, sample1 / second
            drawn, value = self.parts[0].sample(ctx, si, numbers[0], sample2, active & (sample1 >= second))
            other, its_value = self.parts[1].sample(ctx, si, numbers[1], sample2, active & taken)
            drawn = dr.select(taken, other, drawn)
            value = dr.select(taken, its_value, value)
            smooth = active & mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Smooth)
            both, pdf = self.eval_pdf(ctx, si, drawn.wo, smooth)
            drawn.pdf = dr.select(smooth, pdf, drawn.pdf * dr.select(taken, second, first))
            value = dr.select(smooth & (pdf > 0.0), both / pdf, value)
            return drawn, dr.select(active, value, 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            value, pdf = mi.Spectrum(0.0), mi.Float(0.0)
            for share, part in zip(self.shares(si, active), self.parts, strict=True):
                its_value, its_pdf = part.eval_pdf(ctx, si, wo, active)
                value, pdf = value + share * its_value, pdf + share * its_pdf
            return value, pdf

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            parts = zip(self.shares(si, active), self.parts, strict=True)
            return sum((share * part.eval_diffuse_reflectance(si, active) for share, part in parts), mi.Spectrum(0.0))

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            parts = zip(self.shares(si, active), self.parts, strict=True)
            return sum((share * part.eval_null_transmission(si, active) for share, part in parts), mi.Spectrum(0.0))

        def to_string(self) -> str:
            return f"{NAME}[{self.weight}, {self.parts}]"

    mi.register_bsdf(NAME, Blend)


__all__ = ["exact", "register"]
