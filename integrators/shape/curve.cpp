// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/shape/curve.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "framework/base/error.h"

namespace variform {
namespace {

void require_dimension(Eigen::Index dimension) {
  if (dimension != 2 && dimension != 3) {
    throw UsageError(fmt::format("expected points of 2 or 3 coordinates, got {}", dimension));
  }
}

std::string text_of(const Matrix& points, Index k) {
  return fmt::format("point {} = [{}]", k, fmt::join(points.row(k).data(), points.row(k).data() + points.cols(), ", "));
}

void require_points(const Matrix& points, Index least) {
  require_dimension(points.cols());
  if (points.rows() < least) {
    throw UsageError(fmt::format("expected at least {} points, got {}", least, points.rows()));
  }
  for (Index k = 0; k < points.rows(); ++k) {
    if (!points.row(k).allFinite()) throw UsageError(text_of(points, k) + ": expected finite numbers");
  }
}

void require_distinct_neighbours(const Matrix& points) {
  constexpr double kCoincident = 1e-12;  // by the extent of the curve
  const double extent = (points.colwise().maxCoeff() - points.colwise().minCoeff()).norm();
  for (Index k = 1; k < points.rows(); ++k) {
    if (!((points.row(k) - points.row(k - 1)).norm() > kCoincident * extent)) {
      throw UsageError(text_of(points, k) + fmt::format(" coincides with point {}", k - 1));
    }
  }
}

class Arc final : public GuidanceCurve {
 public:
  Arc(const SpacePoint& from, const SpacePoint& centre, double angle, const SpacePoint& axis, const TimeInterval& time)
      : GuidanceCurve(static_cast<int>(from.size()), time), angle_(angle), arm_(from - centre) {
    require_dimension(from.size());
    if (centre.size() != from.size() || !from.allFinite() || !centre.allFinite()) {
      throw UsageError("an arc needs two finite points of the same dimension");
    }
    if (!std::isfinite(angle) || angle == 0.0) throw UsageError(fmt::format("an arc of angle {}", angle));
    centre_ = centre;
    if (from.size() == 2) {
      if (axis.size() != 0) throw UsageError("an axis is for arcs in space");
      side_.resize(2);
      side_ << -arm_[1], arm_[0];
    } else {
      if (axis.size() != 3 || !axis.allFinite() || !(axis.norm() > 0.0)) {
        throw UsageError("an arc in space needs an axis, a direction of 3 numbers");
      }
      const Eigen::Vector3d a = Eigen::Vector3d(axis).normalized();
      const Eigen::Vector3d arm(arm_);
      // The plane of the arc contains its first point; what lies along the axis belongs to the centre.
      centre_ += a.dot(arm) * a;
      arm_ = arm - a.dot(arm) * a;
      side_ = a.cross(arm);
    }
    if (!(side_.norm() > 1e-12 * (from - centre).norm())) {
      throw UsageError("the first point of an arc is its centre or lies on its axis");
    }
  }

 private:
  CurvePoint at_share(double s) const override {
    const double cosine = std::cos(angle_ * s);
    const double sine = std::sin(angle_ * s);
    const SpacePoint out = cosine * arm_ + sine * side_;
    const SpacePoint along = cosine * side_ - sine * arm_;
    return {centre_ + out, angle_ * along, -angle_ * angle_ * out};
  }

  double angle_;
  SpacePoint centre_;
  SpacePoint arm_;   // from the centre to the first point
  SpacePoint side_;  // the same, turned by a right angle
};

class Polynomial final : public GuidanceCurve {
 public:
  Polynomial(Matrix coefficients, const TimeInterval& time)
      : GuidanceCurve(static_cast<int>(coefficients.cols()), time), coefficients_(std::move(coefficients)) {}

 private:
  CurvePoint at_share(double s) const override {
    const int d = dimension();
    CurvePoint c{SpacePoint::Zero(d), SpacePoint::Zero(d), SpacePoint::Zero(d)};
    for (Eigen::Index k = coefficients_.rows() - 1; k >= 0; --k) {  // Horner's rule for all three
      c.acceleration = s * c.acceleration + 2.0 * c.velocity;
      c.velocity = s * c.velocity + c.position;
      c.position = s * c.position + coefficients_.row(k).transpose();
    }
    return c;
  }

  Matrix coefficients_;
};

class Spline final : public GuidanceCurve {
 public:
  Spline(const Matrix& points, const TimeInterval& time)
      : GuidanceCurve(static_cast<int>(points.cols()), time), points_(points), knots_(points.rows()) {
    const Index n = static_cast<Index>(points.rows());
    knots_[0] = 0.0;
    for (Index k = 1; k < n; ++k) knots_[k] = knots_[k - 1] + std::sqrt((points.row(k) - points.row(k - 1)).norm());
    for (double& knot : knots_) knot /= knots_[n - 1];
    knots_[n - 1] = 1.0;
    solve_bends();
  }

 private:
  double gap(Index k) const { return knots_[k + 1] - knots_[k]; }
  Eigen::RowVectorXd slope(Index k) const { return (points_.row(k + 1) - points_.row(k)) / gap(k); }

  /// Second derivatives at the knots: continuity of the first ones is a tridiagonal system, solved by elimination.
  void solve_bends() {
    const auto n = static_cast<Index>(points_.rows());
    bends_ = Matrix::Zero(n, points_.cols());
    Vector factor = Vector::Zero(n);
    for (Index k = 1; k + 1 < n; ++k) {
      const double pivot = 2.0 * (gap(k - 1) + gap(k)) - gap(k - 1) * factor[k - 1];
      factor[k] = gap(k) / pivot;
      bends_.row(k) = (6.0 * (slope(k) - slope(k - 1)) - gap(k - 1) * bends_.row(k - 1)) / pivot;
    }
    for (Index k = n - 2; k >= 1; --k) bends_.row(k) -= factor[k] * bends_.row(k + 1);
  }

  CurvePoint at_share(double s) const override {
    const auto after = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, s);
    const auto k = static_cast<Index>(after - knots_.begin()) - 1;
    const double h = gap(k);
    const double b = (s - knots_[k]) / h;
    const double a = (knots_[k + 1] - s) / h;
    const auto p = [&](Index i) { return points_.row(i).transpose(); };
    const auto m = [&](Index i) { return bends_.row(i).transpose(); };
    CurvePoint c;
    c.position = a * p(k) + b * p(k + 1) + h * h / 6.0 * ((a * a * a - a) * m(k) + (b * b * b - b) * m(k + 1));
    c.velocity = (p(k + 1) - p(k)) / h + h / 6.0 * ((3.0 * b * b - 1.0) * m(k + 1) - (3.0 * a * a - 1.0) * m(k));
    c.acceleration = a * m(k) + b * m(k + 1);
    return c;
  }

  std::vector<double> knot_shares() const override { return {knots_.begin() + 1, knots_.end() - 1}; }

  Matrix points_;
  std::vector<double> knots_;
  Matrix bends_;
};

}  // namespace

void require_interval(const TimeInterval& time) {
  if (!std::isfinite(time.start) || !std::isfinite(time.end) || !(time.start < time.end)) {
    throw UsageError(fmt::format("time = [{}, {}]: expected a start before an end", time.start, time.end));
  }
}

GuidanceCurve::GuidanceCurve(int dimension, const TimeInterval& time) : dimension_(dimension), time_(time) {
  require_interval(time);
}

CurvePoint GuidanceCurve::at(double t) const {
  const double rate = 1.0 / time_.length();
  CurvePoint c = at_share(std::clamp((t - time_.start) * rate, 0.0, 1.0));
  c.velocity *= rate;
  c.acceleration *= rate * rate;
  return c;
}

std::vector<double> GuidanceCurve::knots() const {
  std::vector<double> times = knot_shares();
  for (double& t : times) t = time_.start + t * time_.length();
  return times;
}

std::unique_ptr<GuidanceCurve> make_line(const Matrix& ends, const TimeInterval& time) {
  require_points(ends, 2);
  if (ends.rows() > 2) throw UsageError(fmt::format("a line has 2 points, got {}", ends.rows()));
  require_distinct_neighbours(ends);
  Matrix coefficients = ends;
  coefficients.row(1) -= ends.row(0);
  return std::make_unique<Polynomial>(std::move(coefficients), time);
}

std::unique_ptr<GuidanceCurve> make_arc(const SpacePoint& from, const SpacePoint& centre, double angle,
                                        const SpacePoint& axis, const TimeInterval& time) {
  return std::make_unique<Arc>(from, centre, angle, axis, time);
}

std::unique_ptr<GuidanceCurve> make_polynomial(const Matrix& coefficients, const TimeInterval& time) {
  require_points(coefficients, 2);
  return std::make_unique<Polynomial>(coefficients, time);
}

std::unique_ptr<GuidanceCurve> make_parabola(const Matrix& points, const TimeInterval& time) {
  require_points(points, 3);
  if (points.rows() > 3) throw UsageError(fmt::format("a parabola has 3 points, got {}", points.rows()));
  require_distinct_neighbours(points);
  Matrix coefficients(3, points.cols());
  coefficients.row(0) = points.row(0);
  coefficients.row(1) = -3.0 * points.row(0) + 4.0 * points.row(1) - points.row(2);
  coefficients.row(2) = 2.0 * points.row(0) - 4.0 * points.row(1) + 2.0 * points.row(2);
  return std::make_unique<Polynomial>(std::move(coefficients), time);
}

std::unique_ptr<GuidanceCurve> make_spline(const Matrix& points, const TimeInterval& time) {
  require_points(points, 2);
  require_distinct_neighbours(points);
  return std::make_unique<Spline>(points, time);
}

}  // namespace variform
