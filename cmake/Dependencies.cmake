# Finds every external package (from Debian 12, but for the last one) and repairs their configurations where needed.
find_package(Threads REQUIRED)
find_package(TBB REQUIRED)
find_package(embree 3.12 REQUIRED)
find_package(OpenEXR REQUIRED)
find_package(PNG REQUIRED)
find_package(OpenImageIO REQUIRED)
find_package(pugixml REQUIRED)
find_package(fmt REQUIRED)
find_path(GLM_INCLUDE_DIR glm/glm.hpp REQUIRED)
# Of Highway the headers alone: its library measures a clock when a program starts, which takes 6 ms.
find_path(HWY_INCLUDE_DIR hwy/highway.h REQUIRED)
find_path(CLI11_INCLUDE_DIR CLI/CLI.hpp REQUIRED)
find_path(NLOHMANN_JSON_INCLUDE_DIR nlohmann/json.hpp REQUIRED)
find_package(tinyobjloader REQUIRED)

# Debian's xxHash and Blosc have no CMake files.
find_package(PkgConfig REQUIRED)
pkg_check_modules(XXHASH REQUIRED IMPORTED_TARGET libxxhash>=0.8)
pkg_check_modules(BLOSC REQUIRED IMPORTED_TARGET blosc>=1.16)

# Debian's OpenImageIO names an include folder of OpenCV that is not installed.
get_target_property(_oiio_includes OpenImageIO::OpenImageIO INTERFACE_INCLUDE_DIRECTORIES)
if(_oiio_includes)
  list(FILTER _oiio_includes EXCLUDE REGEX "opencv")
  set_target_properties(OpenImageIO::OpenImageIO PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_oiio_includes}")
endif()

# FindOpenVDB.cmake is installed beside the library, off the module path.
file(GLOB _openvdb_module_dirs /usr/lib/*/cmake/OpenVDB /usr/lib/cmake/OpenVDB)
list(APPEND CMAKE_MODULE_PATH ${_openvdb_module_dirs})
find_package(OpenVDB REQUIRED)

# Optional, for `--denoise` (hybrid/oidn). Debian has no package of it; tools/install_packages.sh --with-oidn puts one for
# Python into build/oidn. That names an include folder which it lacks; hybrid/oidn needs no headers.
file(GLOB _oidn_packages ${PROJECT_SOURCE_DIR}/build/oidn/lib/python3*/site-packages/pyoidn/oidn)
find_package(OpenImageDenoise 2 QUIET CONFIG HINTS ${_oidn_packages})
if(OpenImageDenoise_FOUND)
  set_target_properties(OpenImageDenoise PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "")
  message(STATUS "Denoiser: Open Image Denoise ${OpenImageDenoise_VERSION}")
else()
  message(STATUS "Denoiser: none (tools/install_packages.sh --with-oidn)")
endif()
