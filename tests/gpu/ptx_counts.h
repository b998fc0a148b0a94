// What the kernels do on real questions, counted while their PTX runs on the CPU: instructions, and the 32-byte sectors
// of global memory that their loads and stores touch. Code for it is made by `ptx_to_cpp.py --count`.
//
// Instructions of a warp are those of its basic blocks, each as often as the lane that ran it most often: as if lanes
// that part always met again. Thread-safety: one thread at a time. Errors: as tests/gpu/ptx_semantics.h.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "tests/gpu/ptx_semantics.h"

namespace fieldtrace::ptx {

struct PtxCounts {
  uint64_t warps = 0;
  uint64_t instructions = 0;  // of warps
  uint64_t requests = 0;      // loads and stores of global memory by warps
  // The sectors of each request, and those of each warp, which counts a sector once however often it comes back to it.
  uint64_t request_sectors = 0, warp_sectors = 0;

  PtxCounts& operator+=(const PtxCounts& o) {
    warps += o.warps, instructions += o.instructions, requests += o.requests;
    request_sectors += o.request_sectors, warp_sectors += o.warp_sectors;
    return *this;
  }
};

struct CountingKernel {
  std::string target;  // the architecture
  std::string name;
  uint32_t instructions;  // in its code
  PtxCounts (*launch)(uint32_t blocks, const void* arguments);
};

// Those of one architecture, by the CUDA compiler; none where there is no such compiler.
const std::vector<CountingKernel>& counting_kernels();

inline constexpr uint64_t k_sector_bytes = 32;

struct CountedLane : Lane {
  struct Touch {
    uint32_t instruction;
    uint64_t sector;
  };
  std::vector<Touch> touches;

  // No access crosses a sector: it is aligned to its size.
  void touch(uint32_t instruction, uint64_t address) { touches.push_back({instruction, address / k_sector_bytes}); }
};

// What a warp's lanes did. sizes: instructions of each basic block.
template <class LaneState>
PtxCounts count_warp(const LaneState (&lanes)[k_lanes], std::span<const uint32_t> sizes) {
  PtxCounts counts;
  counts.warps = 1;
  for (size_t b = 0; b < sizes.size(); ++b) {
    uint32_t most = 0;
    for (const LaneState& lane : lanes) most = std::max(most, lane.runs[b]);
    counts.instructions += uint64_t(most) * sizes[b];
  }
  // A lane's n-th run of an instruction belongs to the same request as the other lanes' n-th.
  std::vector<std::tuple<uint32_t, uint32_t, uint64_t>> touched;
  std::vector<uint64_t> sectors;
  std::vector<uint32_t> runs;
  for (const LaneState& lane : lanes) {
    runs.clear();
    for (const CountedLane::Touch& t : lane.touches) {
      if (t.instruction >= runs.size()) runs.resize(t.instruction + 1);
      touched.emplace_back(t.instruction, runs[t.instruction]++, t.sector);
      sectors.push_back(t.sector);
    }
  }
  std::sort(touched.begin(), touched.end());
  touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
  counts.request_sectors = touched.size();
  const auto request_of = [](const auto& t) { return std::pair(std::get<0>(t), std::get<1>(t)); };
  for (size_t i = 0; i < touched.size(); ++i) {
    counts.requests += i == 0 || request_of(touched[i]) != request_of(touched[i - 1]);
  }
  std::sort(sectors.begin(), sectors.end());
  counts.warp_sectors = size_t(std::unique(sectors.begin(), sectors.end()) - sectors.begin());
  return counts;
}

}  // namespace fieldtrace::ptx
