// Whole pictures by the kernels' PTX equal those of the CPU, bit for bit: through an emulated device, and through the
// run-time layer over a library that stands for CUDA's driver.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include "gpu/runtime_cuda.h"
#include "tests/gpu/picture_checks.h"
#include "tests/gpu/ptx_kernels.h"
#include "tests/support/hybrid_scenes.h"

namespace fieldtrace {
namespace {

using namespace test;

// The first variant: all of them pass the tests of parity.
void run_ptx(gpu::Kernel kernel, uint32_t blocks, const void* arguments) {
  for (const ptx::PtxKernel& k : ptx::ptx_kernels()) {
    if (k.name == gpu::k_kernel_names[int(kernel)]) return k.launch(blocks, arguments);
  }
  throw Error(std::string("no kernel ") + gpu::k_kernel_names[int(kernel)]);
}

gpu::EmulatedFaults by_ptx() {
  gpu::EmulatedFaults faults;
  faults.run_kernel = &run_ptx;
  return faults;
}

TEST(PtxPicture, EqualsTheCpusForAllSplitsOfSamples) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  const Scene scene = knot_over_floor(Mat3(1.0f), 48);
  expect_same_picture(scene, options_for(1, 64), "1 x 64", by_ptx());
  expect_same_picture(scene, options_for(16, 4), "16 x 4", by_ptx());
  expect_same_picture(scene, options_for(16, 1), "16 x 1", by_ptx());
  RenderOptions o = options_for(1, 16);
  o.whole_lights = false;
  expect_same_picture(scene, o, "single rays", by_ptx());
}

TEST(PtxPicture, EqualsTheCpusOfSquashedInstances) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  const Mat3 flat(Vec3(1, 0, 0), Vec3(0.1f, 1, 0), Vec3(0, 0, 0.1f));
  expect_same_picture(knot_over_floor(flat, 40), options_for(1, 64), "a tenth", by_ptx());
}

TEST(PtxPicture, EqualsTheCpusOfACrowd) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  const Scene scene = crowd(48);
  expect_same_picture(scene, options_for(1, 32), "1 x 32", by_ptx());
  expect_same_picture(scene, options_for(4, 4), "4 x 4", by_ptx());
}

TEST(PtxPicture, EqualsTheCpusOfTheDemo) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for (const bool sky : {false, true}) {
    const Scene scene = demo(64, sky);
    const RenderOptions o = options_for(4, 4);
    const EmulatedPicture device = render_emulated(scene, o, by_ptx());
    expect_equal(device.result, render(scene, o), sky ? "sky" : "lights");
    expect_no_fault(device, sky ? "sky" : "lights");
    EXPECT_GT(device.log.launches[int(sky ? gpu::Kernel::sky_cells : gpu::Kernel::light_cones)], 0u);
  }
}

// Skies and glossy surfaces, too: what the device has no questions for is the CPU's, and the rest the device's.
TEST(PtxPicture, EqualsTheCpusOfHardScenes) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for (const HybridScene& s : hybrid_scenes(24)) {
    const RenderOptions o = options_for(1, 16);
    const EmulatedPicture device = render_emulated(s.scene, o, by_ptx());
    expect_equal(device.result, render(s.scene, o), s.name);
    EXPECT_TRUE(device.warnings.empty()) << s.name << ": " << device.warnings[0];
    EXPECT_TRUE(is_clean(device.log)) << s.name;
  }
}

TEST(PtxPicture, EqualsTheCpusOfGlossyFloors) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  const Scene scene = glossy_floor(128, true);
  RenderOptions o = glossy_options();
  o.aovs = {"ao"};
  const EmulatedPicture device = render_emulated(scene, o, by_ptx());
  expect_equal(device.result, render(scene, o), "glossy floor");
  expect_no_fault(device, "glossy floor");
  EXPECT_GT(device.log.launches[int(gpu::Kernel::filter_lobes)], 0u);
  EXPECT_GT(device.log.launches[int(gpu::Kernel::sky_cells)], 0u);
}

// Light from below the surface.
TEST(PtxPicture, EqualsTheCpusOfSurfacesThatTransmit) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  Scene scene = knot_over_floor(Mat3(1.0f), 32);
  for (Bsdf& b : scene.bsdfs) b.kind = BsdfKind::rough_dielectric, b.alpha_u = b.alpha_v = 0.5f;
  const RenderOptions o = options_for(1, 16);
  const EmulatedPicture device = render_emulated(scene, o, by_ptx());
  expect_equal(device.result, render(scene, o), "transmits");
  expect_no_fault(device, "transmits");
  EXPECT_GT(device.log.launches[int(gpu::Kernel::light_rays)], 0u);
}

#if defined(FIELDTRACE_EMULATED_DRIVER)
// As the driver gets them: a copy of as many bytes as the launch says.
TEST(PtxPicture, EqualsTheCpusThroughTheRuntimeLayer) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  void* const library = dlopen(FIELDTRACE_EMULATED_DRIVER, RTLD_NOW);
  ASSERT_NE(library, nullptr);
  using RunKernels = void (*)(int, unsigned, const void*);
  const RunKernels run = [](int kernel, unsigned blocks, const void* arguments) {
    run_ptx(gpu::Kernel(kernel), blocks, arguments);
  };
  reinterpret_cast<void (*)(RunKernels)>(dlsym(library, "emulated_driver_run"))(run);
  static const char k_image[] = "kernels";
  DeviceKind kind;
  kind.name = "driver";
  kind.open = [](const DeviceOptions& o) -> std::unique_ptr<VisibilityDevice> {
    return std::make_unique<gpu::GpuDevice>(gpu::open_cuda_runtime(FIELDTRACE_EMULATED_DRIVER),
                                            std::as_bytes(std::span(k_image)), o);
  };
  register_device_kind(kind);
  const Scene scene = knot_over_floor(Mat3(1.0f), 40);
  RenderOptions o = options_for(4, 16);
  const RenderResult cpu = render(scene, o);
  o.device = "driver";
  const RenderResult device = render(scene, o);
  expect_equal(device, cpu, "driver");
  EXPECT_GT(device.stats.device_blocks, 0u);
  EXPECT_EQ(reinterpret_cast<int (*)()>(dlsym(library, "emulated_driver_left"))(), 0);
}
#endif

}  // namespace
}  // namespace fieldtrace
