// Run-time choice of the instruction set: `--isa`, and what this processor supports.
//
// A kernel file compiles its code once per Highway target and exports a table with one function pointer per target,
// from which its *_kernel_for(isa) function chooses. No globals: the choice is passed like any option.
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

namespace fieldtrace {

// scalar: the generic code with one float per lane. sse4 also denotes the baseline vectors of other architectures
// (NEON).
enum class Isa { automatic, scalar, sse4, avx2, avx512 };

const char* isa_name(Isa isa);

// The instruction sets that this processor supports, scalar first, best last.
std::vector<Isa> supported_isas();

// `automatic` becomes the best one. Throws UsageError if this processor cannot run `isa`.
Isa resolve_isa(Isa isa);

}  // namespace fieldtrace
