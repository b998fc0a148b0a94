// The loop over camera samples behind CameraSampler::sample(), for one lane type.
// Thread-safety: writes its outputs only.

#if defined(FIELDTRACE_CORE_CAMERA_CAMERA_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_CAMERA_CAMERA_BATCH_INL_H_
#undef FIELDTRACE_CORE_CAMERA_CAMERA_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_CAMERA_CAMERA_BATCH_INL_H_
#endif

#include "core/camera/camera_kernels.h"
#include "core/camera/camera_rays.hd.h"
#include "core/sampling/sobol.hd.h"

FT_LANES_BEGIN

// Fills `rays`, near_distance and the seeds for all samples. All arrays are padded to whole vectors.
template <class F>
inline void sample_camera_batch(const CameraLens& lens, const CameraSamples& samples, uint32_t picture_seed,
                                RayBatch& rays, float* near_distance, uint32_t* pixel_seeds, uint32_t* vertex_seeds) {
  const Uint_t<F> of_picture = splat_uint<F>(picture_seed), zero = splat_uint<F>(0u);
  Uint_t<F> last_x = zero, last_y = zero, last_replicate = zero, seed = zero, of_vertex = zero;
  SobolSeeds<F> film_seeds = {}, aperture_seeds = {};
  for (size_t i = 0; i < samples.size; i += size_t(Lanes<F>::k_count)) {
    const Uint_t<F> px = load_uint_lanes<F>(samples.x.data() + i), py = load_uint_lanes<F>(samples.y.data() + i);
    const Uint_t<F> index = load_uint_lanes<F>(samples.index.data() + i);
    const Uint_t<F> replicate = load_uint_lanes<F>(samples.replicate.data() + i);
    // Many samples of one sequence share its seeds.
    if (i == 0 || !all((px == last_x) & (py == last_y) & (replicate == last_replicate))) {
      const Uint_t<F> of_replicate = hash_combine_lanes<F>(of_picture, replicate);
      seed = pixel_seed_lanes<F>(select(replicate == zero, of_picture, of_replicate), px, py);
      of_vertex = hash_combine_lanes<F>(seed, zero);
      const Uint_t<F> camera_seed = hash_combine_lanes<F>(seed, splat_uint<F>(k_camera_stream));
      film_seeds = sobol_seeds<F>(camera_seed, 0);
      if (lens.aperture_radius > 0.0f) aperture_seeds = sobol_seeds<F>(camera_seed, 1);
      last_x = px, last_y = py, last_replicate = replicate;
    }
    store_lanes(seed, pixel_seeds + i);
    store_lanes(of_vertex, vertex_seeds + i);
    const UnitPair<F> film = sample_2d<F>(index, film_seeds);
    UnitPair<F> aperture = {splat<F>(0.0f), splat<F>(0.0f)};
    if (lens.aperture_radius > 0.0f) aperture = sample_2d<F>(index, aperture_seeds);
    const F half = splat<F>(0.5f);
    const F x = to_float(as_int(px)) + half + filter_offset<F>(lens, film.x);
    const F y = to_float(as_int(py)) + half + filter_offset<F>(lens, film.y);
    const CameraRayLanes<F> ray = camera_ray<F>(lens, x, y, aperture.x, aperture.y);
    store_lanes(ray.origin.x, rays.ox.data() + i);
    store_lanes(ray.origin.y, rays.oy.data() + i);
    store_lanes(ray.origin.z, rays.oz.data() + i);
    store_lanes(ray.direction.x, rays.dx.data() + i);
    store_lanes(ray.direction.y, rays.dy.data() + i);
    store_lanes(ray.direction.z, rays.dz.data() + i);
    store_lanes(ray.tmax, rays.tmax.data() + i);
    store_lanes(ray.near_distance, near_distance + i);
  }
}

FT_LANES_END

#endif  // toggled guard
