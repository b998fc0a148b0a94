"""The integrator `fieldtrace_direct` for Mitsuba 3: its `direct`, whose shadow rays Fieldtrace answers.

    import mitsuba as mi
    mi.set_variant("llvm_ad_rgb")
    import fieldtrace_direct
    picture = mi.render(mi.load_file("scene.xml"), integrator=mi.load_dict({"type": "fieldtrace_direct"}))

Parameters: emitter_samples and bsdf_samples (1 each), hide_emitters (false), as of `direct`, which it follows step by
step, random numbers included; `shadows`: "fieldtrace", or "mitsuba" for the same code with Mitsuba's own shadow rays;
`tolerance`, `directions`, `plane`: Fieldtrace's settings (README.md). No derivatives. The fields of the last scene are
kept until the next one, or until forget(), which a scene needs whose parameters were changed.

Primary rays, materials, light samples and rays of BSDF samples are Mitsuba's. The shadow rays of a wavefront become three
arrays in memory, which Fieldtrace reads in place.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from fieldtrace_scene import Converted

if not (mi.variant() or "").startswith("llvm"):
    raise ImportError("fieldtrace_direct needs a variant of LLVM: mi.set_variant('llvm_ad_rgb') before it is imported")


def _power_heuristic(a, b):
    weight = dr.square(a) / (dr.square(a) + dr.square(b))
    return dr.select(dr.isfinite(weight), weight, 0)


class FieldtraceDirect(mi.SamplingIntegrator):
    def __init__(self, properties):
        super().__init__(properties)
        self.emitter_samples = int(properties.get("emitter_samples", 1))
        self.bsdf_samples = int(properties.get("bsdf_samples", 1))
        self.hidden_emitters = bool(properties.get("hide_emitters", False))
        self.shadows = str(properties.get("shadows", "fieldtrace"))
        names = ("tolerance", "directions", "plane")
        self.settings = {name: properties[name] for name in names if name in properties}
        if self.shadows not in ("fieldtrace", "mitsuba"):
            raise ValueError(f'shadows: "fieldtrace" or "mitsuba", not "{self.shadows}"')
        self._of, self.converted = None, None

    def forget(self):
        """The next render reads the scene anew, and bakes its fields again."""
        self._of, self.converted = None, None

    def convert(self, scene):
        """The Fieldtrace scene of a scene (fieldtrace_scene.py); render() calls it."""
        if self._of is not scene:
            self.converted = Converted(scene, **self.settings)
            self._of = scene
        return self.converted

    def sample(self, scene, sampler, ray, medium=None, active=True):
        by_fieldtrace = self.shadows == "fieldtrace"
        converted = self.convert(scene) if by_fieldtrace else None
        si = scene.ray_intersect(ray, active)
        valid = si.is_valid()
        result = mi.Spectrum(0)
        seen = active & (valid if self.hidden_emitters else True)
        if not self.hidden_emitters:
            result += si.emitter(scene, seen).eval(si, seen)
        active = active & valid
        context = mi.BSDFContext()
        bsdf = si.bsdf(ray)

        total = self.emitter_samples + self.bsdf_samples
        shadow_rays = []
        smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        for _ in range(self.emitter_samples):
            ds, weight = scene.sample_emitter_direction(si, sampler.next_2d(smooth), not by_fieldtrace, smooth)
            lit = smooth & (ds.pdf != 0)
            value, pdf = bsdf.eval_pdf(context, si, si.to_local(ds.d), lit)
            mis = dr.select(ds.delta, 1, _power_heuristic(ds.pdf * self.emitter_samples, pdf * self.bsdf_samples))
            contribution = dr.select(lit, value * weight * mis / self.emitter_samples, 0)
            if by_fieldtrace:
                lit &= dr.any(contribution != 0)
                shadow_rays.append((si.spawn_ray_to(ds.p), lit, contribution))
            else:
                result += contribution

        for _ in range(self.bsdf_samples):
            # In the order of compiled `direct`, so that one seed gives both the same samples.
            direction, lobe = sampler.next_2d(active), sampler.next_1d(active)
            bs, value = bsdf.sample(context, si, lobe, direction, active)
            going = active & dr.any(value != 0)
            hit = scene.ray_intersect(si.spawn_ray(si.to_world(bs.wo)), going)
            emitter = hit.emitter(scene, going)
            going &= emitter != None  # noqa: E711
            radiance = emitter.eval(hit, going)
            delta = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            ds = mi.DirectionSample3f(scene, hit, si)
            pdf = dr.select(delta, 0, scene.pdf_emitter_direction(si, ds, going & ~delta))
            mis = _power_heuristic(bs.pdf * self.bsdf_samples, pdf * self.emitter_samples)
            result += dr.select(going, value * radiance * mis / self.bsdf_samples, 0)

        if shadow_rays:
            result += self._visible(converted, si, shadow_rays, result)
        return result, valid, []

    def _visible(self, converted, si, shadow_rays, *others):
        """The sum of the contributions whose rays Fieldtrace finds clear. `others` are computed along with them."""
        asked = []
        for ray, lit, contribution in shadow_rays:
            # Fieldtrace skips rays of negative length; their other numbers must be finite all the same.
            origins, directions = dr.select(lit, ray.o, 0), dr.select(lit, ray.d, 1)
            asked.append((dr.ravel(origins), dr.ravel(directions), dr.select(lit, ray.maxt, -1), contribution))
        leaves = converted.instance_of(si, shadow_rays[0][1])
        dr.eval(asked, leaves, others)  # one kernel
        left = leaves.numpy()
        result = mi.Spectrum(0)
        for origins, directions, largest, contribution in asked:
            blocked = converted.scene.occluded(
                origins.numpy().reshape(-1, 3), directions.numpy().reshape(-1, 3), largest.numpy(), left
            )
            result += dr.select(mi.Bool(blocked), 0, contribution)
        return result

    def to_string(self):
        return f"FieldtraceDirect[emitter_samples={self.emitter_samples}, bsdf_samples={self.bsdf_samples}]"


mi.register_integrator("fieldtrace_direct", FieldtraceDirect)
