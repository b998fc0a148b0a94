// A mesh in the unit ball with its direction maps, and how far shares of cells lie from those of rays.
//
// Thread-safety: values.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "core/trace/accel.h"
#include "field/maps/direction_maps.h"
#include "field/store/field.h"
#include "tests/support/cell_tasks.h"

namespace fieldtrace::test {

struct ShareErrors {
  double largest = 0.0, sum = 0.0, signed_sum = 0.0;
  int cells = 0, partial = 0;

  void add(double share, double exact) {
    const double error = std::abs(share - exact);
    largest = std::max(largest, error), sum += error, signed_sum += share - exact;
    ++cells, partial += exact > 0.0 && exact < 1.0;
  }
  double mean() const { return sum / cells; }
  double bias() const { return signed_sum / cells; }
};

struct MappedMesh {
  Scene scene;
  std::unique_ptr<Accel> accel;
  std::unique_ptr<DirectionMaps> maps;

  MappedMesh(TriangleMesh mesh, const MapSize& size) {
    const Sphere ball = field_ball(mesh.bounds());
    for (Vec3& p : mesh.positions) p = (p - ball.centre) / ball.radius;
    Shape shape;
    shape.bounds = mesh.bounds();
    shape.mesh = std::move(mesh);
    scene.shapes.push_back(std::move(shape));
    accel = std::make_unique<Accel>(scene);
    maps = std::make_unique<DirectionMaps>(Sphere{Vec3(0.0f), 1.0f}, size);
    BakeCounters counters;
    bake_maps(*maps, *accel, 0, DMat3(1.0), nullptr, counters);
  }

  // The part of side x side rays from `p` over a cell that are blocked within `distance`.
  double share(const Vec3& p, int cell, int side, float distance = k_infinity) const {
    return blocked_mean(p, cell, side, distance, [](const Vec3&) { return 1.0; });
  }

  // Of the cosines of these rays for the normal `n`, over their number, what is blocked.
  double received(const Vec3& p, const Vec3& n, int cell, int side) const {
    return blocked_mean(p, cell, side, k_infinity,
                        [&](const Vec3& d) { return std::max(double(glm::dot(n, d)), 0.0); });
  }

 private:
  template <class Weight>
  double blocked_mean(const Vec3& p, int cell, int side, float distance, const Weight& weight) const {
    const size_t count = size_t(side * side);
    RayBatch rays;
    rays.resize(count);
    for (size_t i = 0; i < count; ++i) {
      const float x = (float(i / size_t(side)) + 0.5f) / float(side),
                  y = (float(i % size_t(side)) + 0.5f) / float(side);
      rays.set(i, p, direction_in(cell, maps->size().directions, x, y), distance);
    }
    std::vector<uint8_t> blocked(padded(count), 0);
    accel->shape_occluded(0, rays, blocked.data());
    double sum = 0.0;
    for (size_t i = 0; i < count; ++i) sum += blocked[i] ? weight(rays.direction(i)) : 0.0;
    return sum / double(count);
  }
};

}  // namespace fieldtrace::test
