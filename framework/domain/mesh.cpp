// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/mesh.h"

namespace variform {

int flat_axis(const Mesh& mesh) {
  if (mesh.cells.cols() != 3 || mesh.positions.cols() != 3 || mesh.positions.rows() == 0) return -1;
  const Eigen::RowVector3d extent = mesh.positions.colwise().maxCoeff() - mesh.positions.colwise().minCoeff();
  for (const int axis : {2, 1, 0}) {
    if (extent[axis] <= 1e-12 * extent.norm()) return axis;
  }
  return -1;
}

Mesh flattened(const Mesh& mesh) {
  const int axis = flat_axis(mesh);
  if (axis < 0) return mesh;
  Mesh flat{Matrix(mesh.positions.rows(), 2), mesh.cells};
  flat.positions.col(0) = mesh.positions.col(axis == 0 ? 1 : 0);
  flat.positions.col(1) = mesh.positions.col(axis == 2 ? 1 : 2);
  return flat;
}

}  // namespace variform
