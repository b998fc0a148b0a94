#include "tools/thesis/vdb_file.h"

#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>

#include <filesystem>
#include <vector>

#include "core/atomic_file.h"
#include "core/error.h"
#include "field/chart_thesis.hd.h"

namespace fieldtrace {
namespace {

constexpr int32_t k_no_normal = k_thesis_normal_zero * 0x010101;

// `values` in the order of the field's samples, which is that of a dense grid with z fastest.
openvdb::Int32Grid::Ptr make_grid(const char* name, std::vector<int32_t>& values, int m, int32_t background) {
  const openvdb::CoordBBox box(openvdb::Coord(0), openvdb::Coord(scalar::k_thesis_positions - 1, m - 1, m - 1));
  const openvdb::tools::Dense<int32_t, openvdb::tools::LayoutZYX> dense(box, values.data());
  const openvdb::Int32Grid::Ptr grid = openvdb::Int32Grid::create(background);
  openvdb::tools::copyFromDense(dense, *grid, 0);
  grid->setName(name);
  return grid;
}

}  // namespace

uint64_t write_thesis_vdb(const ThesisField& field, const std::string& path) {
  openvdb::initialize();
  const ThesisFieldView view = field.view();
  const size_t count = field.samples();
  std::vector<int32_t> values(count);
  for (size_t i = 0; i < count; ++i) values[i] = view.distance[i];
  openvdb::GridPtrVec grids;
  grids.push_back(make_grid("distance", values, field.m(), k_thesis_miss));
  for (size_t i = 0; i < count; ++i) {
    const uint8_t* n = view.normal + 3 * i;
    values[i] = n[0] | n[1] << 8 | n[2] << 16;
  }
  grids.push_back(make_grid("normal", values, field.m(), k_no_normal));
  AtomicFile file(path);
  try {
    openvdb::MetaMap meta;
    meta.insertMeta("chart", openvdb::StringMetadata("thesis"));
    meta.insertMeta("directions", openvdb::Int32Metadata(field.m()));
    meta.insertMeta("centre",
                    openvdb::Vec3SMetadata({field.ball().centre.x, field.ball().centre.y, field.ball().centre.z}));
    meta.insertMeta("radius", openvdb::FloatMetadata(field.ball().radius));
    openvdb::io::File out(file.temporary_path());
    out.setCompression(openvdb::io::COMPRESS_ZIP | openvdb::io::COMPRESS_ACTIVE_MASK);
    out.write(grids, meta);
    out.close();
  } catch (const openvdb::Exception& e) {
    throw Error({path}, std::string("cannot be written: ") + e.what());
  }
  file.commit();
  return std::filesystem::file_size(path);
}

}  // namespace fieldtrace
