// What fields cost in accuracy: hybrid pictures against Monte Carlo pictures of the same samples, checked answers, and
// the counters of a render.

#include <gtest/gtest.h>

#include <cmath>

#include "hybrid/compare.h"
#include "hybrid/render.h"
#include "tests/hybrid_scenes.h"

namespace fieldtrace {
namespace {

using test::hybrid_scene;
using test::hybrid_scenes;
using test::HybridScene;

RenderOptions options_for(Method method, int light_samples) {
  RenderOptions o;
  o.method = method;
  o.light_samples = light_samples;
  o.seed = 11;
  o.threads = 2;
  return o;
}

double mean(const Image& image) {
  double sum = 0.0;
  for (const float v : image.data) sum += v;
  return sum / double(image.data.size());
}

TEST(HybridError, Measure) {
  for (const HybridScene& s : hybrid_scenes(48)) {
    RenderOptions o = options_for(Method::monte_carlo, 64);
    const RenderResult mc = render(s.scene, o);
    o.method = Method::hybrid;
    o.check = true;
    const RenderResult h = render(s.scene, o);
    const ImageDifference d = compare_images(h.image, mc.image);
    o.tolerance = 1;
    const RenderResult one = render(s.scene, o);
    const ImageDifference d1 = compare_images(one.image, mc.image);
    const double m = mean(mc.image);
    std::printf(
        "%-18s mean %.3f rmse %.5f block %.5f | t1 %.5f block %.5f bias %.4f exact %llu of %llu | ask %.3f | answers "
        "%llu wrong %.5f\n",
        s.name.c_str(), m, d.rmse / m, d.worst_block_rmse / m, d1.rmse / m, d1.worst_block_rmse / m, d1.bias,
        (unsigned long long)one.stats.rays_exact, (unsigned long long)one.stats.rays_crossing, h.stats.exact_fraction(),
        (unsigned long long)h.stats.check_answers, double(h.stats.check_wrong) / double(h.stats.check_answers));
  }
}

}  // namespace
}  // namespace fieldtrace
