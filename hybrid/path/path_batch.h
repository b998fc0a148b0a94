// The state of a batch of paths between two surfaces, shared by the transport loop and its direct-light stage.
//
// Memory layout: arrays of structs; one batch holds a few thousand paths (about half a megabyte).
// Thread-safety: values; a batch belongs to one thread.
#pragma once

#include <cstdint>
#include <vector>

#include "core/material/bsdf.h"
#include "core/math/frame.h"
#include "core/surface/surface.h"
#include "core/trace/rays.h"

namespace fieldtrace {

// One path; its next ray has the same index in the batch.
struct PathState {
  Rgb throughput = Rgb(1.0f);
  // The part of the throughput that a plastic's interface reflects, where maps have lit its body; else 1.
  Rgb interface_share = Rgb(1.0f);
  float eta = 1.0f;         // product of the relative indices passed so far: undoes radiance scaling in roulette
  uint32_t slot = 0;        // the camera sample that the path belongs to, within the batch
  uint32_t pixel_seed = 0;  // see core/sampling/sobol.hd.h
  uint32_t index = 0;       // place in the pixel's sample sequence
  bool may_split = true;    // no diffuse or split surface met yet
  bool shows = true;        // only smooth surfaces met yet; of a camera sample's paths, one
  bool direct = true;       // along the camera ray still, through masks and thin glass
  // The surface that the ray left, for weighting emission that the ray finds:
  bool unweighted = true;  // camera rays and delta lobes: nothing else samples this emission
  bool diffuse = false;    // emission of lights sampled in closed form is not added again
  bool transmits = false;
  float bsdf_density = 0.0f;  // samples x solid-angle density of the chosen direction
  int light_samples = 1;
  Vec3 normal = Vec3(0.0f, 0.0f, 1.0f);  // shading normal
  // Of a glossy ray, for fields and prefiltered radiance maps: the roughness of its lobe (0: not glossy), and its
  // surface.
  float alpha = 0.0f;
  Vec3 side = Vec3(0.0f, 0.0f, 1.0f);  // geometric normal on the ray's side
  uint32_t instance = 0xffffffffu;
};

// A surface that a path has reached and continues from.
struct PathVertex {
  uint32_t path = 0;  // index of the PathState
  // Owned by the worker that reached the surface, until its next wave; in TransportWorker::follow() by the caller.
  const SurfacePoint* surface = nullptr;
  const Material* material = nullptr;  // likewise
  // The shading frame; n lies on the side that the material scatters to. frame.s, frame.t and wi are unspecified where
  // the material is plainly diffuse and no path continues: light samples need n alone.
  Frame frame;
  Vec3 facing = Vec3(0.0f, 0.0f, 1.0f);  // geometric normal on the side of the arriving ray
  Vec3 wi = Vec3(0.0f, 0.0f, 1.0f);      // back along the arriving ray, in the frame
  uint32_t seed = 0;                     // of the pixel and vertex
  float lobe_samples = 1.0f;             // directions that will be sampled from the material
};

}  // namespace fieldtrace
