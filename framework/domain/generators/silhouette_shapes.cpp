// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/generators/silhouette_shapes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace variform::generators {
namespace {

using Eigen::Vector2d;

/// Signed distance to the convex hull of the circles about two joints, of which none lies inside the other.
double capsule_distance(const Joint& a, const Joint& b, const Vector2d& p) {
  const Vector2d axis = b.place - a.place;
  const double length = axis.norm();
  const Vector2d offset = p - a.place;
  const double along = offset.dot(axis) / length;
  const double across = std::abs(axis.x() * offset.y() - axis.y() * offset.x()) / length;
  // The straight sides are tilted against the axis by the angle with this sine and cosine.
  const double sine = (a.radius - b.radius) / length;
  const double cosine = std::sqrt(1.0 - sine * sine);
  const double foot = cosine * along - sine * across;
  if (foot < 0.0) return offset.norm() - a.radius;
  if (foot > cosine * length) return (p - b.place).norm() - b.radius;
  return cosine * across + sine * along - a.radius;
}

double stroke_distance(const Stroke& stroke, const Vector2d& p) {
  double distance = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < stroke.size(); ++i) {
    distance = std::min(distance, capsule_distance(stroke[i - 1], stroke[i], p));
  }
  return distance;
}

/// The strokes and their mirror images about the y axis.
std::vector<Stroke> with_mirrored(std::vector<Stroke> strokes) {
  const std::size_t count = strokes.size();
  for (std::size_t i = 0; i < count; ++i) {
    Stroke mirrored = strokes[i];
    for (Joint& joint : mirrored) joint.place.x() *= -1.0;
    strokes.push_back(std::move(mirrored));
  }
  return strokes;
}

std::vector<Stroke> joined(std::vector<Stroke> strokes, std::vector<Stroke> more) {
  strokes.insert(strokes.end(), more.begin(), more.end());
  return strokes;
}

/// Arm of a cactus: leaves the trunk at `start` sideways by `run`, bends upwards with radius `bend` and rises by
/// `rise`.
Stroke bent_arm(const Vector2d& start, double run, double bend, double rise, double radius) {
  constexpr int kPieces = 6;
  const double side = run < 0.0 ? -1.0 : 1.0;
  Stroke arm = {{start, radius}};
  for (int i = 0; i <= kPieces; ++i) {
    const double angle = 0.5 * std::numbers::pi * i / kPieces;
    arm.push_back({start + Vector2d(run + side * bend * std::sin(angle), bend * (1.0 - std::cos(angle))), radius});
  }
  arm.push_back({arm.back().place + Vector2d(0.0, rise), radius});
  return arm;
}

/// Neighbouring limbs keep clear of each other by at least 1.5 smallest radii, so that no admissible h bridges the gap.
std::vector<Silhouette> make_silhouettes() {
  const Silhouette figure = {
      "figure",
      joined({{{{0.0, 0.875}, 0.060}, {{0.0, 0.905}, 0.070}},                       // head
              {{{0.0, 0.86}, 0.032}, {{0.0, 0.68}, 0.036}},                         // neck
              {{{0.0, 0.66}, 0.088}, {{0.0, 0.53}, 0.070}, {{0.0, 0.43}, 0.078}}},  // torso
             with_mirrored({
                 {{{0.02, 0.692}, 0.050}, {{0.095, 0.690}, 0.042}},                            // shoulder
                 {{{0.100, 0.690}, 0.036}, {{0.265, 0.575}, 0.025}, {{0.440, 0.640}, 0.020}},  // arm
                 {{{0.440, 0.640}, 0.024}, {{0.475, 0.655}, 0.026}},                           // hand
                 {{{0.048, 0.43}, 0.056}, {{0.115, 0.24}, 0.034}, {{0.150, 0.035}, 0.022}},    // leg
                 {{{0.150, 0.032}, 0.026}, {{0.215, 0.026}, 0.020}},                           // foot
             })),
      0.04, true};

  const Silhouette giraffe = {"giraffe",
                              {
                                  {{{-0.16, 0.52}, 0.095}, {{0.02, 0.54}, 0.115}, {{0.14, 0.575}, 0.115}},   // body
                                  {{{0.17, 0.60}, 0.085}, {{0.27, 0.82}, 0.048}, {{0.34, 1.04}, 0.036}},     // neck
                                  {{{0.345, 1.055}, 0.046}, {{0.475, 1.01}, 0.026}},                         // head
                                  {{{0.335, 1.08}, 0.018}, {{0.330, 1.155}, 0.018}},                         // horn
                                  {{{0.315, 1.06}, 0.022}, {{0.250, 1.085}, 0.018}},                         // ear
                                  {{{0.20, 0.52}, 0.045}, {{0.215, 0.27}, 0.025}, {{0.215, 0.025}, 0.020}},  // legs
                                  {{{0.10, 0.50}, 0.042}, {{0.095, 0.27}, 0.025}, {{0.110, 0.025}, 0.020}},
                                  {{{-0.10, 0.48}, 0.042}, {{-0.095, 0.27}, 0.025}, {{-0.115, 0.025}, 0.020}},
                                  {{{-0.20, 0.50}, 0.050}, {{-0.210, 0.27}, 0.026}, {{-0.225, 0.025}, 0.020}},
                                  {{{-0.24, 0.56}, 0.022}, {{-0.32, 0.50}, 0.018}, {{-0.345, 0.36}, 0.018}},  // tail
                                  {{{-0.345, 0.36}, 0.020}, {{-0.350, 0.32}, 0.028}},
                              },
                              0.03};

  const Silhouette frog = {
      "frog",
      joined({{{{0.0, -0.16}, 0.10}, {{0.0, 0.06}, 0.145}, {{0.0, 0.25}, 0.090}}},  // body and head
             with_mirrored({
                 {{{0.082, 0.265}, 0.044}, {{0.078, 0.275}, 0.044}},                        // eye
                 {{{0.07, -0.17}, 0.060}, {{0.36, -0.04}, 0.036}},                          // thigh
                 {{{0.36, -0.04}, 0.034}, {{0.27, -0.34}, 0.022}},                          // shank
                 {{{0.27, -0.34}, 0.022}, {{0.40, -0.40}, 0.020}, {{0.53, -0.33}, 0.018}},  // toes
                 {{{0.40, -0.40}, 0.018}, {{0.555, -0.42}, 0.018}},
                 {{{0.39, -0.395}, 0.018}, {{0.510, -0.50}, 0.018}},
                 {{{0.10, 0.12}, 0.040}, {{0.27, 0.115}, 0.026}},  // upper arm
                 {{{0.27, 0.115}, 0.026}, {{0.36, 0.28}, 0.020}},  // lower arm
                 {{{0.36, 0.28}, 0.020}, {{0.315, 0.39}, 0.018}},  // fingers
                 {{{0.36, 0.28}, 0.020}, {{0.405, 0.40}, 0.018}},
                 {{{0.36, 0.28}, 0.020}, {{0.475, 0.33}, 0.018}},
             })),
      0.03, true};

  const Silhouette cactus = {"cactus",
                             {
                                 {{{0.0, 0.08}, 0.078}, {{0.0, 0.55}, 0.085}, {{0.0, 0.96}, 0.066}},  // trunk
                                 bent_arm({0.0, 0.38}, 0.13, 0.11, 0.24, 0.040),                      // arms
                                 bent_arm({0.0, 0.28}, -0.16, 0.13, 0.22, 0.042),
                                 bent_arm({0.0, 0.66}, -0.09, 0.08, 0.16, 0.030),
                                 bent_arm({0.24, 0.56}, 0.07, 0.07, 0.14, 0.024),  // twigs
                                 bent_arm({-0.29, 0.44}, -0.07, 0.06, 0.12, 0.022),
                                 bent_arm({0.0, 0.79}, 0.08, 0.05, 0.09, 0.024),
                             },
                             0.03};

  return {figure, giraffe, frog, cactus};
}

}  // namespace

double Silhouette::distance(const Vector2d& p) const {
  // Polynomial smooth minimum: a convex combination of the distances less a bit, so its slope stays below 1.
  double distance = std::numeric_limits<double>::infinity();
  for (const Stroke& stroke : strokes) {
    const double other = stroke_distance(stroke, p);
    const double overlap = std::max(blend - std::abs(distance - other), 0.0);
    distance = std::min(distance, other) - overlap * overlap / (4.0 * blend);
  }
  return distance;
}

double Silhouette::smallest_radius() const {
  double radius = std::numeric_limits<double>::infinity();
  for (const Stroke& stroke : strokes) {
    for (const Joint& joint : stroke) radius = std::min(radius, joint.radius);
  }
  return radius;
}

const std::vector<Silhouette>& silhouettes() {
  static const std::vector<Silhouette> kSilhouettes = make_silhouettes();
  return kSilhouettes;
}

}  // namespace variform::generators
