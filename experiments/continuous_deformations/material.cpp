// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/continuous_deformations/material.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

namespace variform {
namespace {

const std::vector<std::string> kKeys = {"region", "phi", "along", "direction", "stiffness"};

int coordinate(const ConfigNode& node) {
  const std::string along = node.string_or("along", "x");
  if (along != "x" && along != "y" && along != "z") node.at("along").fail("expected \"x\", \"y\" or \"z\"");
  return along == "x" ? 0 : along == "y" ? 1 : 2;
}

// One value, or two at both ends.
std::vector<double> phi_of(const ConfigNode& node) {
  const ConfigNode phi = node.at("phi");
  const std::vector<double> values = phi.value().is_array() ? phi.numbers() : std::vector<double>{phi.number()};
  if (values.size() != 1 && values.size() != 2) phi.fail("expected a number or [low, high]");
  if (!std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); })) {
    phi.fail("expected finite numbers");
  }
  return values;
}

}  // namespace

void check_materials(const std::vector<ConfigNode>& nodes) {
  for (const ConfigNode& node : nodes) {
    node.accept_keys(kKeys);
    if (!node.has("phi") && !node.has("direction")) node.fail("expected phi, or direction with stiffness");
    if (node.has("phi")) phi_of(node);
    if (node.has("along")) {
      if (!node.has("phi") || phi_of(node).size() != 2) node.at("along").fail("needs phi = [low, high]");
      coordinate(node);
    }
    if (node.has("direction") != node.has("stiffness")) node.fail("expected direction and stiffness together");
    if (node.has("direction")) {
      const std::vector<double> direction = node.at("direction").numbers();
      double squared = 0.0;
      for (const double component : direction) squared += component * component;
      if (!(squared > 0.0 && std::isfinite(squared))) node.at("direction").fail("expected a vector other than 0");
      const double stiffness = node.at("stiffness").number();
      if (!(stiffness > 0.0 && std::isfinite(stiffness))) node.at("stiffness").fail("expected a positive number");
    }
    if (node.has("region")) node.at("region").numbers();
  }
}

Material load_material(const std::vector<ConfigNode>& nodes, const Domain& domain) {
  check_materials(nodes);
  const int p = domain.ambient_dimension();
  const Index cells = domain.cell_count();
  Material material;
  for (const ConfigNode& node : nodes) {
    if (node.has("phi") && material.phi.size() == 0) {
      material.phi = Vector::Constant(cells, std::numeric_limits<double>::quiet_NaN());
    }
    if (node.has("direction") && material.tensors.size() == 0) {
      material.tensors = Matrix::Zero(cells, p * p);
      for (int i = 0; i < p; ++i) material.tensors.col(i * p + i).setOnes();
    }
    std::vector<double> box;
    if (node.has("region")) box = node.at("region").numbers();
    if (!box.empty() && box.size() != static_cast<std::size_t>(2 * p)) {
      node.at("region").fail(fmt::format("expected {} numbers on this mesh", 2 * p));
    }
    const int axis = coordinate(node);
    if (axis >= p) node.at("along").fail("the mesh is planar");
    const double low = domain.positions().col(axis).minCoeff();
    const double extent = domain.positions().col(axis).maxCoeff() - low;
    Eigen::VectorXd t;
    if (node.has("direction")) {
      const std::vector<double> direction = node.at("direction").numbers();
      if (direction.size() != static_cast<std::size_t>(p)) {
        node.at("direction").fail(fmt::format("expected {} numbers on this mesh", p));
      }
      t = Eigen::Map<const Eigen::VectorXd>(direction.data(), p).normalized();
    }
    Index found = 0;
    for (Index cell = 0; cell < cells; ++cell) {
      Eigen::RowVectorXd centroid = Eigen::RowVectorXd::Zero(p);
      for (int i = 0; i < domain.cell_size(); ++i) {
        centroid += domain.positions().row(domain.cells()(cell, i)) / domain.cell_size();
      }
      bool inside = true;
      for (int c = 0; c < p && !box.empty(); ++c) {
        inside = inside && centroid[c] >= box[static_cast<std::size_t>(c)] &&
                 centroid[c] <= box[static_cast<std::size_t>(p + c)];
      }
      if (!inside) continue;
      ++found;
      if (node.has("phi")) {
        const std::vector<double> phi = phi_of(node);
        material.phi[cell] = phi.front() + (phi.back() - phi.front()) * (centroid[axis] - low) / extent;
      }
      if (t.size() > 0) {
        const Eigen::MatrixXd B =
            Eigen::MatrixXd::Identity(p, p) + (node.at("stiffness").number() - 1.0) * t * t.transpose();
        material.tensors.row(cell) = Eigen::Map<const Eigen::RowVectorXd>(B.data(), p * p);
      }
    }
    if (found == 0) node.fail("no cell has its centroid in the region");
  }
  return material;
}

void check_has_material(const ConfigNode& type, const Energy& energy) {
  if (dynamic_cast<const VectorFieldEnergy*>(&energy) != nullptr) return;
  type.fail("alpha and [[material]] are for akvf, metr, conf, auth and phi");
}

std::function<void(const Matrix&)> apply_material(const ConfigNode& node, const Material& material,
                                                  const Domain& domain, bool gradient,
                                                  std::unique_ptr<Energy>& energy) {
  if (gradient || material.phi.size() > 0 || material.tensors.size() > 0) check_has_material(node.at("type"), *energy);
  const auto* const field = dynamic_cast<const VectorFieldEnergy*>(energy.get());
  if (field == nullptr) return {};
  Vector parameter = field->parameter();
  if (material.phi.size() > 0) {
    if (field->kind() != VectorFieldKind::phi) node.at("type").fail("[[material]] with phi needs type = \"phi\"");
    const double own = parameter[0];
    parameter = material.phi.unaryExpr([own](double phi) { return std::isnan(phi) ? own : phi; });
  }
  // One tensor for all is carried along cell by cell.
  Matrix tensors = material.tensors;
  if (tensors.size() == 0 && field->tensors().size() > 0) tensors = field->tensors().replicate(domain.cell_count(), 1);
  const Smoothness smoothness = gradient ? Smoothness::gradient : field->smoothness();
  auto made =
      node.located([&] { return std::make_unique<VectorFieldEnergy>(field->kind(), parameter, tensors, smoothness); });
  VectorFieldEnergy* const carried = made.get();
  energy = std::move(made);
  if (tensors.size() == 0) return {};
  return [carried, tensors, &domain](const Matrix& positions) {
    carried->set_tensors(rotated_tensors(domain, positions, tensors));
  };
}

double smoothing_beta(const Energy& energy, const Domain& domain, double alpha) {
  const auto& field = dynamic_cast<const VectorFieldEnergy&>(energy);
  const VectorFieldWeights weights = field.isotropic_weights(domain.ambient_dimension());
  return beta_from_alpha(alpha / std::hypot(weights.strain, weights.divergence));
}

}  // namespace variform
