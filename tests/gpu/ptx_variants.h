// Runs tests over all translations of a kernel's PTX.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "tests/gpu/ptx_kernels.h"

namespace fieldtrace::gpu {

inline constexpr size_t k_least_entries = 1 << 20;

// Calls run(launch, architectures) for each variant of a kernel.
template <class Arguments, class Run>
void for_each_variant(const std::string& name, const Run& run) {
  int variants = 0;
  for (const ptx::PtxKernel& kernel : ptx::ptx_kernels()) {
    if (kernel.name != name) continue;
    ASSERT_EQ(kernel.argument_bytes, sizeof(Arguments));
    ++variants;
    run([&](const Arguments& a) { kernel.launch(a.warps, &a); }, kernel.targets);
    if (testing::Test::HasFatalFailure()) return;
  }
  ASSERT_GT(variants, 0);
}

}  // namespace fieldtrace::gpu
