// A renderer of its own: a floor of its own in Embree, objects of Fieldtrace attached to the same Embree scene, and
// soft shadows by rtcOccluded1(). Writes embree_renderer.ppm.
#include <fieldtrace/fieldtrace_embree.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

struct V {
  float x, y, z;
};
V operator+(V a, V b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
V operator-(V a, V b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
V operator*(float s, V a) { return {s * a.x, s * a.y, s * a.z}; }
float dot(V a, V b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
V unit(V a) { return 1.0f / std::sqrt(dot(a, a)) * a; }

// A ring about the y axis.
void make_torus(std::vector<V>& positions, std::vector<uint32_t>& triangles) {
  const uint32_t m = 96, n = 32;
  for (uint32_t i = 0; i < m; ++i) {
    for (uint32_t j = 0; j < n; ++j) {
      const float a = 6.2831853f * float(i) / m, b = 6.2831853f * float(j) / n;
      const float r = 1.0f + 0.35f * std::cos(b);
      positions.push_back({r * std::cos(a), 0.35f * std::sin(b), r * std::sin(a)});
      const uint32_t p = i * n + j, q = i * n + (j + 1) % n, s = (i + 1) % m * n + j, t = (i + 1) % m * n + (j + 1) % n;
      for (const uint32_t v : {p, q, s, q, t, s}) triangles.push_back(v);
    }
  }
}

void attach_floor(RTCDevice device, RTCScene scene) {
  RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  const float p[12] = {-6, 0, -6, -6, 0, 6, 6, 0, 6, 6, 0, -6};
  const unsigned t[6] = {0, 1, 2, 0, 2, 3};
  auto* to = static_cast<float*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 4));
  auto* at = static_cast<unsigned*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 2));
  for (int i = 0; i < 12; ++i) to[i] = p[i];
  for (int i = 0; i < 6; ++i) at[i] = t[i];
  rtcCommitGeometry(g);
  rtcAttachGeometry(scene, g);
  rtcReleaseGeometry(g);
}

RTCRayHit ray(V o, V d, float t_max) {
  RTCRayHit r = {};
  r.ray = {o.x, o.y, o.z, 1e-3f, d.x, d.y, d.z, 0.0f, t_max, ~0u, 0, 0};
  r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return r;
}

int main() {
  FTDevice ft = nullptr;
  FTScene objects = nullptr;
  std::vector<V> positions;
  std::vector<uint32_t> triangles;
  make_torus(positions, triangles);
  uint32_t mesh = 0;
  const float lying[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, -1.3f, 0.35f, 0};
  const float standing[12] = {0.8f, 0.3f, 0, 0, 0, 1, 0.3f, -0.8f, 0, 1.2f, 1.25f, 0.2f};
  RTCDevice embree = rtcNewDevice(nullptr);
  RTCScene world = rtcNewScene(embree);
  attach_floor(embree, world);
  if (ftNewDevice(0, &ft) || ftNewScene(ft, &objects) ||
      ftAddMesh(objects, &positions[0].x, 0, positions.size(), triangles.data(), 0, triangles.size() / 3, &mesh) ||
      ftAddInstance(objects, mesh, lying, nullptr) || ftAddInstance(objects, mesh, standing, nullptr) ||
      ftCommitScene(objects) || ftAttachEmbree(objects, embree, world, nullptr)) {
    const char* message = "";
    ftGetDeviceError(ft, &message);
    std::fprintf(stderr, "%s\n", message);
    return 1;
  }
  rtcCommitScene(world);

  const int width = 192, height = 128, samples = 16;
  const V eye = {0, 4, 7}, forward = unit(V{0, 0.4f, 0} - eye), right = unit(V{-forward.z, 0, forward.x});
  const V up = {right.y * forward.z - right.z * forward.y, right.z * forward.x - right.x * forward.z,
                right.x * forward.y - right.y * forward.x};
  std::mt19937 random(1);
  std::uniform_real_distribution<float> u(0.0f, 1.0f);
  std::vector<unsigned char> picture;
  for (int i = 0; i < width * height; ++i) {
    float sum = 0.0f;
    for (int s = 0; s < samples; ++s) {
      const float x = (float(i % width) + u(random)) / width - 0.5f, y = 0.5f - (float(i / width) + u(random)) / height;
      const V d = unit(forward + 0.8f * x * right + 0.8f * float(height) / width * y * up);
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      RTCRayHit r = ray(eye, d, INFINITY);
      rtcIntersect1(world, &context, &r);
      if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
      V n = unit({r.hit.Ng_x, r.hit.Ng_y, r.hit.Ng_z});
      if (dot(n, d) > 0.0f) n = -1.0f * n;
      const V p = eye + r.ray.tfar * d, to_light = V{3, 6, 2} + V{2 * u(random), 0, 2 * u(random)} - p;
      RTCRayHit shadow = ray(p + 1e-3f * n, to_light, 1.0f);
      rtcOccluded1(world, &context, &shadow.ray);
      if (shadow.ray.tfar > 0.0f) sum += std::fmax(dot(n, unit(to_light)), 0.0f) * 40.0f / dot(to_light, to_light);
    }
    const float value = 255.0f * std::sqrt(std::fmin(0.8f * sum / samples, 1.0f));
    picture.insert(picture.end(), 3, static_cast<unsigned char>(value));
  }
  std::FILE* file = std::fopen("embree_renderer.ppm", "wb");
  if (!file) return 1;
  std::fprintf(file, "P6\n%d %d\n255\n", width, height);
  std::fwrite(picture.data(), 1, picture.size(), file);
  const bool failed = std::fclose(file) != 0;
  if (ftDetachEmbree(objects, world) || ftReleaseScene(objects) || ftReleaseDevice(ft)) return 1;
  rtcReleaseScene(world);
  rtcReleaseDevice(embree);
  return failed;
}
