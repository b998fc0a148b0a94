// One read of a depth cell by the fields' page table, and of the same cell by NanoVDB, to be compiled and compared
// (docs/decisions/029-nanovdb.md); never run. Voxels are those of field files (field/file/field_grids.h): a leaf holds a brick.
#include <nanovdb/NanoVDB.h>

#include "field/store/layout.hd.h"

namespace fieldtrace {
namespace {

__device__ nanovdb::Coord voxel_of(const FieldView& field, const scalar::CellAddress<float>& at) {
  const int direction_brick = (at.u >> 2) * field.direction_bricks + (at.v >> 2);
  const int in_brick = ((at.u & 3) << 2 | (at.v & 3)) << 5 | (at.a & 3) << 3 | (at.b & 7);
  // A leaf's voxels in their order: x, then y, then z, 3 bits each.
  return {direction_brick * 8 + (in_brick >> 6), (at.a >> 2) * 8 + (in_brick >> 3 & 7),
          (at.b >> 3) * 8 + (in_brick & 7)};
}

__device__ scalar::CellAddress<float> address(const int4* cells, int i) {
  const int4 c = cells[i];
  return {c.x, c.y, c.z, c.w, {}};
}

}  // namespace

extern "C" __global__ void read_page_table(const __grid_constant__ FieldView field, const int4* cells, int* out) {
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x);
  out[i] = scalar::gather(field.depth, scalar::slot_of<float>(field, address(cells, i)).cell);
}

extern "C" __global__ void read_nanovdb(const __grid_constant__ FieldView field, const nanovdb::Int32Grid* grid,
                                        const int4* cells, int* out) {
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x);
  out[i] = grid->tree().getValue(voxel_of(field, address(cells, i)));
}

// By an accessor, which keeps the nodes that it met: of use to threads that read more than one cell.
extern "C" __global__ void read_nanovdb_accessor(const __grid_constant__ FieldView field,
                                                 const nanovdb::Int32Grid* grid, const int4* cells, int* out) {
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x);
  auto accessor = grid->getAccessor();
  out[i] = accessor.getValue(voxel_of(field, address(cells, 2 * i))) +
           accessor.getValue(voxel_of(field, address(cells, 2 * i + 1)));
}

}  // namespace fieldtrace
