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

// One path whose next ray is ray i of a batch (i: the path's own place).
struct PathState {
  Rgb throughput = Rgb(1.0f);
  float eta = 1.0f;         // product of the relative indices passed so far: undoes radiance scaling in roulette
  uint32_t slot = 0;        // the camera sample that the path belongs to, within the batch
  uint32_t pixel_seed = 0;  // see core/sampling/sobol.hd.h
  uint32_t index = 0;       // place in the pixel's sample sequence
  bool may_split = true;    // no diffuse or split surface met yet
  // Of the surface that the ray left, for weighting emission that the ray finds:
  bool unweighted = true;  // camera rays and delta lobes: nothing else samples this emission
  bool diffuse = false;    // lights sampled in closed form count by their light samples alone
  bool transmits = false;
  float bsdf_density = 0.0f;  // samples x solid-angle density of the chosen direction
  int light_samples = 1;
  Vec3 normal = Vec3(0.0f, 0.0f, 1.0f);  // shading
  // Of a glossy ray, for answers by pictures of radiance: roughness of its lobe (0: not glossy), and the surface.
  float alpha = 0.0f;
  Vec3 side = Vec3(0.0f, 0.0f, 1.0f);  // geometric normal on the ray's side
  uint32_t instance = 0xffffffffu;
};

// A surface that a path has reached and from which it goes on.
struct PathVertex {
  uint32_t path = 0;  // index of the PathState
  // Where the worker that reached the surface keeps it until its next wave; for TransportWorker::follow() the caller's.
  const SurfacePoint* surface = nullptr;
  const Material* material = nullptr;  // likewise
  // Shading; n lies on the side that the material scatters to. frame.s, frame.t and wi are not specified where the
  // material is a cosine lobe and nothing else and no path goes on: light samples ask for n alone.
  Frame frame;
  Vec3 facing = Vec3(0.0f, 0.0f, 1.0f);  // geometric normal on the side of the arriving ray
  Vec3 wi = Vec3(0.0f, 0.0f, 1.0f);      // back along the arriving ray, in the frame
  uint32_t seed = 0;                     // of the pixel and vertex
  float lobe_samples = 1.0f;             // directions that will be sampled from the material
};

}  // namespace fieldtrace
