// Choice of the instruction set at run time: `--isa`, and what this processor offers.
//
// A kernel file compiles its code once for each Highway target and exports one table of function pointers per target;
// kernels_for(isa) picks one. Nothing is kept in globals: the choice is passed like any option.
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

namespace fieldtrace {

// scalar: the generic code with one float a lane. sse4 also stands for a processor's baseline vectors elsewhere (NEON).
enum class Isa { automatic, scalar, sse4, avx2, avx512 };

const char* isa_name(Isa isa);

// The instruction sets that this processor can run, scalar first, best last.
std::vector<Isa> supported_isas();

// `automatic` becomes the best one. Throws UsageError if this processor cannot run `isa`.
Isa resolve_isa(Isa isa);

}  // namespace fieldtrace
