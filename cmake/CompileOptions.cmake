# fieldtrace_options: language level, warnings and floating-point rules for every target.
add_library(fieldtrace_options INTERFACE)
target_compile_features(fieldtrace_options INTERFACE cxx_std_20)
target_include_directories(fieldtrace_options INTERFACE ${PROJECT_SOURCE_DIR})
# Kernels are compiled for SSE4, AVX2 and AVX-512 (and the compiler's baseline, which Highway requires).
option(FIELDTRACE_AVX2_ONLY "Compile everything for AVX2, and kernels for nothing else (for sanitizers)" OFF)
if(FIELDTRACE_AVX2_ONLY)
  target_compile_definitions(fieldtrace_options INTERFACE HWY_COMPILE_ONLY_STATIC)
  target_compile_options(fieldtrace_options INTERFACE
    $<$<COMPILE_LANGUAGE:CXX>:-mavx2 -mfma -mbmi -mbmi2 -mf16c -maes -mpclmul>)
else()
  target_compile_definitions(fieldtrace_options INTERFACE
    "HWY_DISABLED_TARGETS=(HWY_SSSE3|HWY_AVX3_DL)")
endif()
# No contraction and no fast-math: addresses must agree bit for bit on every instruction set.
target_compile_options(fieldtrace_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-ffp-contract=off -Wall -Wextra -Wshadow -Wno-psabi>)
# GCC 12 reports -Wrestrict inside the standard library's operator+ for strings (its bug 105651).
target_compile_options(fieldtrace_options INTERFACE
  $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:-Wno-restrict>)
if(FIELDTRACE_WERROR)
  target_compile_options(fieldtrace_options INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Werror>)
endif()

set(FIELDTRACE_SANITIZE "" CACHE STRING "Value for -fsanitize=, empty for none")
if(FIELDTRACE_SANITIZE)
  add_compile_options(-fsanitize=${FIELDTRACE_SANITIZE} -fno-omit-frame-pointer)
  add_link_options(-fsanitize=${FIELDTRACE_SANITIZE})
  if(NOT FIELDTRACE_SANITIZE MATCHES "thread")
    add_compile_options(-fno-sanitize-recover=all)
  endif()
endif()

# A program loads at start only the libraries that it uses itself. OpenImageIO and OpenVDB, which pull in some 250, lie in
# modules (fieldtrace_module() in Components.cmake).
add_link_options(-Wl,--as-needed)

# fieldtrace_vector_kernels(FILE TARGET): for TARGET's FILE, of the calling folder, that Highway compiles once per
# instruction set. The undefined behaviour checks of every inlined vector operation take the compiler ten minutes there;
# the same templates are checked as scalar code, and the memory checks stay. The preset ubsan-avx2 checks one
# instruction set.
function(fieldtrace_vector_kernels file target)
  if(FIELDTRACE_SANITIZE MATCHES "undefined" AND NOT FIELDTRACE_AVX2_ONLY)
    set_source_files_properties(${file} TARGET_DIRECTORY ${target}
      PROPERTIES COMPILE_OPTIONS "-fno-sanitize=undefined,float-cast-overflow")
  endif()
endfunction()

# fieldtrace_within_library(TARGET): TARGET becomes part of libfieldtrace.so, which shows none of its symbols.
function(fieldtrace_within_library target)
  set_target_properties(${target} PROPERTIES
    POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
endfunction()
