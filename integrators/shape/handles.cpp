// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/shape/handles.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unsupported/Eigen/MatrixFunctions>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "framework/base/error.h"

namespace variform {
namespace {

using Eigen::Vector3d;

constexpr double kForever = std::numeric_limits<double>::infinity();

void require_finite(const SpacePoint& x, const std::string& what) {
  if (x.size() != 2 && x.size() != 3) {
    throw UsageError(fmt::format("{}: expected 2 or 3 numbers, got {}", what, x.size()));
  }
  if (!x.allFinite()) {
    throw UsageError(
        fmt::format("{} = [{}]: expected finite numbers", what, fmt::join(x.data(), x.data() + x.size(), ", ")));
  }
}

void require_same_dimension(const SpacePoint& a, const SpacePoint& b, const std::string& what) {
  if (a.size() != b.size()) throw UsageError(fmt::format("{}: {} and {} coordinates", what, a.size(), b.size()));
}

std::vector<double> inside(std::vector<double> times, double t0, double t1) {
  std::erase_if(times, [&](double t) { return !(t > t0 && t < t1); });
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  return times;
}

/// What moves in one interval.
class IntervalMotion : public Motion {
 public:
  IntervalMotion(int dimension, const TimeInterval& time) : dimension_(dimension), time_(time) {
    require_interval(time);
  }

  int dimension() const final { return dimension_; }
  TimeInterval time() const final { return time_; }

  SpacePoint velocity(double t, const SpacePoint& x) const final {
    if (t < time_.start || t > time_.end) return SpacePoint::Zero(dimension_);
    return moving(t, x);
  }

  bool closed_form() const override { return true; }

  SpacePoint position(double t0, const SpacePoint& x0, double t) const final {
    const double from = std::clamp(t0, time_.start, time_.end);
    const double to = std::clamp(t, time_.start, time_.end);
    return from == to ? x0 : moved(from, x0, to);
  }

  std::vector<double> breaks(double t0, double t1) const final {
    std::vector<double> times = interior_breaks();
    times.push_back(time_.start);
    times.push_back(time_.end);
    return inside(std::move(times), t0, t1);
  }

 protected:
  /// As the public ones, for times in the interval.
  virtual SpacePoint moving(double t, const SpacePoint& x) const = 0;
  virtual SpacePoint moved(double t0, const SpacePoint& x0, double t) const = 0;
  virtual std::vector<double> interior_breaks() const { return {}; }

 private:
  int dimension_;
  TimeInterval time_;
};

/// Turns in the plane, or about an axis in space.
class Turn {
 public:
  Turn() = default;
  Turn(int dimension, const SpacePoint& axis) : axis_(axis) {
    if (dimension == 2) {
      if (axis.size() != 0) throw UsageError("an axis is for rotations in space");
      return;
    }
    if (axis.size() != 3 || !axis.allFinite() || !(axis.norm() > 0.0)) {
      throw UsageError("a rotation in space needs an axis, a direction of 3 numbers");
    }
    axis_.normalize();
  }

  /// Turned by a right angle, without what lies along the axis.
  SpacePoint across(const SpacePoint& x) const {
    if (axis_.size() == 0) {
      SpacePoint y(2);
      y << -x[1], x[0];
      return y;
    }
    return Vector3d(Vector3d(axis_).cross(Vector3d(x)));
  }

  SpacePoint operator()(double angle, const SpacePoint& x) const {
    SpacePoint y = std::cos(angle) * x + std::sin(angle) * across(x);
    if (axis_.size() != 0) y += (1.0 - std::cos(angle)) * along(x) * axis_;
    return y;
  }

  double along(const SpacePoint& x) const { return axis_.size() == 0 ? 0.0 : axis_.dot(x); }

 private:
  SpacePoint axis_;
};

class Follow final : public IntervalMotion {
 public:
  explicit Follow(std::shared_ptr<const GuidanceCurve> curve)
      : IntervalMotion(curve->dimension(), curve->time()), curve_(std::move(curve)) {}

  bool depends_on_place() const override { return false; }

 private:
  SpacePoint moving(double t, const SpacePoint&) const override { return curve_->at(t).velocity; }
  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override {
    return x0 + (curve_->at(t).position - curve_->at(t0).position);
  }
  std::vector<double> interior_breaks() const override { return curve_->knots(); }

  std::shared_ptr<const GuidanceCurve> curve_;
};

/// Nodes and weights of Gauss's rule with 8 points on [0, 1], the upper half.
constexpr std::array<std::array<double, 2>, 4> kGauss = {{{0.1834346424956498, 0.3626837833783620},
                                                          {0.5255324099163290, 0.3137066458778873},
                                                          {0.7966664774136267, 0.2223810344533745},
                                                          {0.9602898564975363, 0.1012285362903763}}};

template <class Function>
double integral(const Function& f, double a, double b) {
  const double middle = 0.5 * (a + b);
  const double half = 0.5 * (b - a);
  double sum = 0.0;
  for (const auto& [node, weight] : kGauss) sum += weight * (f(middle - half * node) + f(middle + half * node));
  return half * sum;
}

class FollowOriented final : public IntervalMotion {
 public:
  explicit FollowOriented(std::shared_ptr<const GuidanceCurve> curve)
      : IntervalMotion(curve->dimension(), curve->time()), curve_(std::move(curve)) {
    std::vector<double> ends = curve_->knots();
    ends.insert(ends.begin(), time().start);
    ends.push_back(time().end);
    nodes_.push_back({ends.front(), Eigen::Quaterniond::Identity()});
    for (std::size_t k = 1; k < ends.size(); ++k) {
      for (int part = 0; part < kParts; ++part) {
        const double step = (ends[k] - ends[k - 1]) / kParts;
        refine(ends[k - 1] + part * step, part + 1 == kParts ? ends[k] : ends[k - 1] + (part + 1) * step, 0);
      }
    }
  }

  bool depends_on_place() const override { return true; }

 private:
  static constexpr int kParts = 4;  // of the pieces of the curve, at least

  struct Node {
    double time;
    Eigen::Quaterniond turn;  // from the start
  };

  static Vector3d in_space(const SpacePoint& x) { return {x[0], x[1], x.size() == 3 ? x[2] : 0.0}; }
  static Vector3d spin(const CurvePoint& c) {
    const Vector3d velocity = in_space(c.velocity);
    const double square = velocity.squaredNorm();
    // Where the curve stops for a moment without turning there is nothing to turn.
    return square > 0.0 ? Vector3d(velocity.cross(in_space(c.acceleration)) / square) : Vector3d::Zero();
  }

  Vector3d tangent(double t) const {
    const Vector3d velocity = in_space(curve_->at(t).velocity);
    const double span = (curve_->at(time().end).position - curve_->at(time().start).position).norm() +
                        (curve_->at(t).position - curve_->at(time().start).position).norm();
    if (!(velocity.norm() * time().length() > 1e-9 * span)) {
      throw UsageError(
          fmt::format("the curve stops at t = {:.6g}, where it has no tangent to follow; expected none of that with "
                      "orient = true",
                      t));
    }
    return velocity.normalized();
  }

  /// Rate at which the rotation that carries the tangent `a` to the present one by the shortest way has to be turned
  /// about the latter to be the rotation-minimizing one: the rate of the area that an arc from `a` sweeps on the
  /// sphere.
  double twist_rate(const Vector3d& a, double t) const {
    const CurvePoint c = curve_->at(t);
    const Vector3d velocity = in_space(c.velocity);
    const double speed = velocity.norm();
    return speed > 0.0 ? a.dot(spin(c)) / (1.0 + a.dot(velocity) / speed) : 0.0;
  }

  double twist(const Vector3d& a, double from, double to) const {
    if (dimension() == 2) return 0.0;
    return integral([&](double t) { return twist_rate(a, t); }, from, to);
  }

  Eigen::Quaterniond turn_between(double from, double to) const {
    const Vector3d a = tangent(from);
    const Vector3d b = tangent(to);
    return Eigen::Quaterniond(Eigen::AngleAxisd(twist(a, from, to), b)) * Eigen::Quaterniond::FromTwoVectors(a, b);
  }

  /// Appends nodes in (a, b], close enough for the integrals and for tangents to turn a little from one to the next.
  void refine(double a, double b, int depth) {
    constexpr double kLeastCosine = 0.95;
    constexpr double kAccuracy = 1e-14;
    constexpr int kDepth = 40;
    const double middle = 0.5 * (a + b);
    const Vector3d start = tangent(a);
    const Vector3d half = tangent(middle);
    const bool turns_little = start.dot(half) > kLeastCosine && half.dot(tangent(b)) > kLeastCosine;
    if (turns_little && std::abs(twist(start, a, b) - twist(start, a, middle) - twist(start, middle, b)) <= kAccuracy) {
      nodes_.push_back({b, (turn_between(a, b) * nodes_.back().turn).normalized()});
      return;
    }
    if (depth == kDepth) {
      throw UsageError(
          fmt::format("the curve turns back at t = {:.6g}, where it has no tangent to follow; expected none of that "
                      "with orient = true",
                      middle));
    }
    refine(a, middle, depth + 1);
    refine(middle, b, depth + 1);
  }

  Eigen::Quaterniond turn(double t) const {
    auto after = std::upper_bound(nodes_.begin(), nodes_.end(), t, [](double x, const Node& n) { return x < n.time; });
    const Node& node = *std::prev(after);
    return t == node.time ? node.turn : turn_between(node.time, t) * node.turn;
  }

  SpacePoint moving(double t, const SpacePoint& x) const override {
    const CurvePoint c = curve_->at(t);
    const Vector3d turned = spin(c).cross(in_space(x - c.position));
    return c.velocity + turned.head(dimension());
  }

  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override {
    const Vector3d arm = turn(t) * (turn(t0).conjugate() * in_space(x0 - curve_->at(t0).position));
    return curve_->at(t).position + arm.head(dimension());
  }

  std::vector<double> interior_breaks() const override { return curve_->knots(); }

  std::shared_ptr<const GuidanceCurve> curve_;
  std::vector<Node> nodes_;
};

class Translate final : public IntervalMotion {
 public:
  Translate(const SpacePoint& velocity, const TimeInterval& time)
      : IntervalMotion(static_cast<int>(velocity.size()), time), velocity_(velocity) {
    require_finite(velocity, "velocity");
  }

  bool depends_on_place() const override { return false; }

 private:
  SpacePoint moving(double, const SpacePoint&) const override { return velocity_; }
  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override { return x0 + (t - t0) * velocity_; }

  SpacePoint velocity_;
};

class Rotate final : public IntervalMotion {
 public:
  Rotate(const SpacePoint& centre, const SpacePoint& axis, double speed, const TimeInterval& time)
      : IntervalMotion(static_cast<int>(centre.size()), time),
        centre_(centre),
        turn_(static_cast<int>(centre.size()), axis),
        speed_(speed) {
    require_finite(centre, "about");
    if (!std::isfinite(speed)) throw UsageError(fmt::format("angular speed {}: expected a finite number", speed));
  }

  bool depends_on_place() const override { return true; }

 private:
  SpacePoint moving(double, const SpacePoint& x) const override { return speed_ * turn_.across(x - centre_); }
  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override {
    return centre_ + turn_(speed_ * (t - t0), x0 - centre_);
  }

  SpacePoint centre_;
  Turn turn_;
  double speed_;
};

class Bend final : public IntervalMotion {
 public:
  Bend(const SpacePoint& base, const SpacePoint& tip, const SpacePoint& axis, double angle, const TimeInterval& time)
      : IntervalMotion(static_cast<int>(base.size()), time), base_(base), turn_(static_cast<int>(base.size()), axis) {
    require_finite(base, "base of the rod");
    require_finite(tip, "tip of the rod");
    require_same_dimension(base, tip, "ends of the rod");
    if (!std::isfinite(angle)) throw UsageError(fmt::format("angle {}: expected a finite number", angle));
    rod_ = tip - base;
    if (!(rod_.norm() > 0.0)) throw UsageError("the ends of the rod coincide");
    if (std::abs(turn_.along(rod_)) > 1e-9 * rod_.norm()) {
      throw UsageError("the axis of a bend is across the rod: expected a right angle between them");
    }
    side_ = turn_.across(rod_);
    speed_ = angle / time.length();
  }

  bool depends_on_place() const override { return true; }

 private:
  double angle(double t) const { return speed_ * (t - time().start); }

  /// sin(a) / a, (1 - cos(a)) / a and their derivatives.
  struct Shape {
    double along, aside, along_rate, aside_rate;
  };
  static Shape shape(double a) {
    constexpr double kSmall = 0.02;  // where series are exact to rounding
    const double q = a * a;
    if (std::abs(a) < kSmall) {
      return {1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0)), a / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0)),
              -a / 3.0 * (1.0 - q / 10.0 * (1.0 - q / 28.0)), 0.5 - q / 8.0 * (1.0 - q / 18.0 * (1.0 - q / 40.0))};
    }
    const double along = std::sin(a) / a;
    const double aside = (1.0 - std::cos(a)) / a;
    return {along, aside, (std::cos(a) - along) / a, (std::sin(a) - aside) / a};
  }

  SpacePoint end(double a) const { return base_ + shape(a).along * rod_ + shape(a).aside * side_; }

  SpacePoint moving(double t, const SpacePoint& x) const override {
    const double a = angle(t);
    const Shape s = shape(a);
    return speed_ * (s.along_rate * rod_ + s.aside_rate * side_ + turn_.across(x - end(a)));
  }
  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override {
    return end(angle(t)) + turn_(angle(t) - angle(t0), x0 - end(angle(t0)));
  }

  SpacePoint base_;
  Turn turn_;
  SpacePoint rod_;
  SpacePoint side_;
  double speed_ = 0.0;
};

using SpaceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 3, 3>;

class LinearField final : public IntervalMotion {
 public:
  LinearField(int dimension, const std::vector<Eigen::MatrixXd>& A, const std::vector<SpacePoint>& b,
              const TimeInterval& time)
      : IntervalMotion(dimension, time) {
    for (const Eigen::MatrixXd& a : A) {
      if (a.rows() != dimension || a.cols() != dimension) {
        throw UsageError(fmt::format("A is {} x {}, expected {} x {}", a.rows(), a.cols(), dimension, dimension));
      }
      if (!a.allFinite()) throw UsageError("A: expected finite numbers");
      A_.emplace_back(a);
    }
    for (const SpacePoint& v : b) {
      require_finite(v, "b");
      if (v.size() != dimension) {
        throw UsageError(fmt::format("b has {} coordinates, expected {}", v.size(), dimension));
      }
      b_.push_back(v);
    }
  }

  bool depends_on_place() const override { return !A_.empty(); }
  bool closed_form() const override { return A_.size() <= 1 && b_.size() <= 1; }

 private:
  SpacePoint moving(double t, const SpacePoint& x) const override {
    const double s = t - time().start;
    SpacePoint v = SpacePoint::Zero(dimension());
    for (std::size_t k = std::max(A_.size(), b_.size()); k-- > 0;) {
      v *= s;
      if (k < A_.size()) v += A_[k] * x;
      if (k < b_.size()) v += b_[k];
    }
    return v;
  }

  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override {
    if (!closed_form()) throw UsageError("a linear field that changes with time has no position in closed form");
    const int d = dimension();
    Eigen::Matrix4d field = Eigen::Matrix4d::Zero();
    if (!A_.empty()) field.topLeftCorner(d, d) = (t - t0) * A_.front();
    if (!b_.empty()) field.topRightCorner(d, 1) = (t - t0) * b_.front();
    const Eigen::Matrix4d power = field.exp();
    return power.topLeftCorner(d, d) * x0 + power.topRightCorner(d, 1);
  }

  std::vector<SpaceMatrix> A_;
  std::vector<SpacePoint> b_;
};

class Reversed final : public IntervalMotion {
 public:
  Reversed(MotionPointer motion, const TimeInterval& interval)
      : IntervalMotion(motion->dimension(), interval),
        motion_(std::move(motion)),
        rate_(motion_->time().length() / interval.length()) {}

  bool depends_on_place() const override { return motion_->depends_on_place(); }
  bool closed_form() const override { return motion_->closed_form(); }

 private:
  double own_time(double t) const {
    const TimeInterval inner = motion_->time();
    return std::clamp(inner.end - rate_ * (t - time().start), inner.start, inner.end);
  }
  SpacePoint moving(double t, const SpacePoint& x) const override { return -rate_ * motion_->velocity(own_time(t), x); }
  SpacePoint moved(double t0, const SpacePoint& x0, double t) const override {
    return motion_->position(own_time(t0), x0, own_time(t));
  }
  std::vector<double> interior_breaks() const override {
    const TimeInterval inner = motion_->time();
    std::vector<double> times = motion_->breaks(inner.start, inner.end);
    for (double& t : times) t = time().start + (inner.end - t) / rate_;
    return times;
  }

  MotionPointer motion_;
  double rate_;
};

class Sequence final : public Motion {
 public:
  explicit Sequence(std::vector<MotionPointer> motions) : motions_(std::move(motions)) {
    if (motions_.empty()) throw UsageError("a sequence of no motions");
    for (std::size_t k = 1; k < motions_.size(); ++k) {
      const TimeInterval before = motions_[k - 1]->time();
      const TimeInterval after = motions_[k]->time();
      if (after.start < before.end) {
        throw UsageError(fmt::format("segment {} starts at t = {}, before segment {} ends at t = {}", k, after.start,
                                     k - 1, before.end));
      }
      if (motions_[k]->dimension() != motions_[0]->dimension()) {
        throw UsageError(fmt::format("segment {} moves points of {} coordinates, segment 0 of {}", k,
                                     motions_[k]->dimension(), motions_[0]->dimension()));
      }
    }
  }

  int dimension() const override { return motions_.front()->dimension(); }
  TimeInterval time() const override { return {motions_.front()->time().start, motions_.back()->time().end}; }
  bool depends_on_place() const override {
    return std::ranges::any_of(motions_, [](const MotionPointer& m) { return m->depends_on_place(); });
  }
  bool closed_form() const override {
    return std::ranges::all_of(motions_, [](const MotionPointer& m) { return m->closed_form(); });
  }

  SpacePoint velocity(double t, const SpacePoint& x) const override {
    for (auto motion = motions_.rbegin(); motion != motions_.rend(); ++motion) {
      if (t >= (*motion)->time().start) return (*motion)->velocity(t, x);
    }
    return SpacePoint::Zero(dimension());
  }

  SpacePoint position(double t0, const SpacePoint& x0, double t) const override {
    SpacePoint x = x0;
    const std::size_t count = motions_.size();
    for (std::size_t k = 0; k < count; ++k) {  // each stands still outside its interval
      x = motions_[t >= t0 ? k : count - 1 - k]->position(t0, x, t);
    }
    return x;
  }

  std::vector<double> breaks(double t0, double t1) const override {
    std::vector<double> times;
    for (const MotionPointer& motion : motions_) {
      const std::vector<double> more = motion->breaks(t0, t1);
      times.insert(times.end(), more.begin(), more.end());
    }
    return inside(std::move(times), t0, t1);
  }

 private:
  std::vector<MotionPointer> motions_;
};

class Weighted final : public Motion {
 public:
  Weighted(MotionPointer motion, std::vector<WeightKnot> knots) : motion_(std::move(motion)), knots_(std::move(knots)) {
    if (knots_.empty()) throw UsageError("a weight needs at least one knot [time, weight]");
    for (std::size_t k = 0; k < knots_.size(); ++k) {
      const auto [t, w] = knots_[k];
      if (!std::isfinite(t) || !std::isfinite(w) || w < 0.0) {
        throw UsageError(
            fmt::format("weight knot {} = [{}, {}]: expected a finite time and a weight of at least 0", k, t, w));
      }
      if (k > 0 && !(t > knots_[k - 1].time)) {
        throw UsageError(
            fmt::format("weight knot {} at t = {} is not after the one before, at t = {}", k, t, knots_[k - 1].time));
      }
      own_.push_back(k == 0 ? t : own_.back() + 0.5 * (w + knots_[k - 1].weight) * (t - knots_[k - 1].time));
    }
  }

  int dimension() const override { return motion_->dimension(); }
  bool depends_on_place() const override { return motion_->depends_on_place(); }
  bool closed_form() const override { return motion_->closed_form(); }

  TimeInterval time() const override {
    const TimeInterval inner = motion_->time();
    // Without a weight that gets there the way is never begun or ended.
    const auto outer = [&](double own, double otherwise) {
      const std::vector<double> times = times_of(own);
      return times.empty() ? otherwise : times.front();
    };
    const double start = outer(inner.start, std::min(inner.start, knots_.front().time));
    return {start, std::max(outer(inner.end, std::max(inner.end, knots_.back().time)), start)};
  }

  SpacePoint velocity(double t, const SpacePoint& x) const override {
    return weight(t) * motion_->velocity(own_time(t), x);
  }
  SpacePoint position(double t0, const SpacePoint& x0, double t) const override {
    return motion_->position(own_time(t0), x0, own_time(t));
  }

  std::vector<double> breaks(double t0, double t1) const override {
    std::vector<double> times;
    for (const WeightKnot& knot : knots_) times.push_back(knot.time);
    for (const double own : motion_->breaks(-kForever, kForever)) {
      for (const double t : times_of(own)) times.push_back(t);
    }
    return inside(std::move(times), t0, t1);
  }

 private:
  /// The piece between knots that a time is in: the knot at its start, or the first one for times before it.
  std::size_t piece(double t) const {
    std::size_t k = 0;
    while (k + 1 < knots_.size() && t >= knots_[k + 1].time) ++k;
    return k;
  }
  double slope(std::size_t k, double t) const {
    if (k + 1 == knots_.size() || t < knots_[k].time) return 0.0;
    return (knots_[k + 1].weight - knots_[k].weight) / (knots_[k + 1].time - knots_[k].time);
  }

  double weight(double t) const {
    const std::size_t k = piece(t);
    return knots_[k].weight + slope(k, t) * (t - knots_[k].time);
  }

  double own_time(double t) const {
    const std::size_t k = piece(t);
    const double gone = t - knots_[k].time;
    const double own = own_[k] + gone * (knots_[k].weight + 0.5 * slope(k, t) * gone);
    // Rounding must not end a motion early.
    const TimeInterval inner = motion_->time();
    const double slack = 1e-14 * std::max({1.0, std::abs(inner.start), std::abs(inner.end)});
    if (std::abs(own - inner.start) <= slack) return inner.start;
    if (std::abs(own - inner.end) <= slack) return inner.end;
    return own;
  }

  /// When own_time is `own`, at most one time: where the weight is 0 the time is a knot anyway.
  std::vector<double> times_of(double own) const {
    if (own <= own_.front()) {
      if (knots_.front().weight == 0.0) return {};
      return {knots_.front().time + (own - own_.front()) / knots_.front().weight};
    }
    for (std::size_t k = 0; k < knots_.size(); ++k) {
      const bool last = k + 1 == knots_.size();
      if (!last && own > own_[k + 1]) continue;
      const double w = knots_[k].weight;
      const double m = last ? 0.0 : slope(k, knots_[k].time);
      const double root = w + std::sqrt(std::max(w * w + 2.0 * m * (own - own_[k]), 0.0));
      if (root > 0.0) return {knots_[k].time + 2.0 * (own - own_[k]) / root};
      return {};
    }
    return {};
  }

  MotionPointer motion_;
  std::vector<WeightKnot> knots_;
  std::vector<double> own_;  // at the knots
};

/// A piece without breaks by Runge and Kutta's method with 2^k steps, extrapolated, until two results agree.
SpacePoint integrated(const Motion& motion, double t0, const SpacePoint& x0, double t1) {
  constexpr double kAccuracy = 1e-13;
  constexpr int kMaxSteps = 1 << 15;
  const double low = std::min(t0, t1);
  const double high = std::max(t0, t1);
  const double margin = 1e-13 * (high - low);  // jumps lie at the ends
  const auto f = [&](double t, const SpacePoint& x) {
    return motion.velocity(std::clamp(t, low + margin, high - margin), x);
  };
  const auto run = [&](int steps) {
    SpacePoint x = x0;
    const double h = (t1 - t0) / steps;
    for (int i = 0; i < steps; ++i) {
      const double t = t0 + i * h;
      const SpacePoint a = f(t, x);
      const SpacePoint b = f(t + 0.5 * h, x + 0.5 * h * a);
      const SpacePoint c = f(t + 0.5 * h, x + 0.5 * h * b);
      const SpacePoint d = f(t + h, x + h * c);
      x += h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
    }
    return x;
  };
  SpacePoint coarse = run(16);
  SpacePoint best = coarse;
  for (int steps = 32; steps <= kMaxSteps; steps *= 2) {
    const SpacePoint fine = run(steps);
    const SpacePoint next = fine + (fine - coarse) / 15.0;
    const bool done = steps > 32 && (next - best).norm() <= kAccuracy * (1.0 + next.norm());
    best = next;
    coarse = fine;
    if (done) break;
  }
  return best;
}

std::string name_of(const Handle& handle, std::size_t k) {
  return handle.name.empty() ? fmt::format("handle {}", k) : handle.name;
}

}  // namespace

MotionPointer follow(std::shared_ptr<const GuidanceCurve> curve) { return std::make_shared<Follow>(std::move(curve)); }

MotionPointer follow_oriented(std::shared_ptr<const GuidanceCurve> curve) {
  return std::make_shared<FollowOriented>(std::move(curve));
}

MotionPointer translate(const SpacePoint& velocity, const TimeInterval& time) {
  return std::make_shared<Translate>(velocity, time);
}

MotionPointer rotate(const SpacePoint& centre, const SpacePoint& axis, double speed, const TimeInterval& time) {
  return std::make_shared<Rotate>(centre, axis, speed, time);
}

MotionPointer bend(const SpacePoint& base, const SpacePoint& tip, const SpacePoint& axis, double angle,
                   const TimeInterval& time) {
  return std::make_shared<Bend>(base, tip, axis, angle, time);
}

MotionPointer linear_field(const Eigen::MatrixXd& A, const SpacePoint& b, const TimeInterval& time) {
  return polynomial_field({A}, {b}, time);
}

MotionPointer polynomial_field(const std::vector<Eigen::MatrixXd>& A, const std::vector<SpacePoint>& b,
                               const TimeInterval& time) {
  if (A.empty() && b.empty()) throw UsageError("a linear field needs A or b");
  const auto d = static_cast<int>(A.empty() ? b.front().size() : A.front().rows());
  if (d != 2 && d != 3) throw UsageError(fmt::format("a linear field of {} coordinates; expected 2 or 3", d));
  return std::make_shared<LinearField>(d, A, b, time);
}

MotionPointer reversed(MotionPointer motion, const TimeInterval& time) {
  return std::make_shared<Reversed>(std::move(motion), time);
}

MotionPointer in_sequence(std::vector<MotionPointer> motions) { return std::make_shared<Sequence>(std::move(motions)); }

MotionPointer weighted(MotionPointer motion, std::vector<WeightKnot> knots) {
  return std::make_shared<Weighted>(std::move(motion), std::move(knots));
}

SpacePoint flow(const Motion& motion, double t0, const SpacePoint& x0, double t) {
  if (motion.closed_form()) return motion.position(t0, x0, t);
  std::vector<double> times = motion.breaks(std::min(t0, t), std::max(t0, t));
  if (t < t0) std::reverse(times.begin(), times.end());
  times.push_back(t);
  SpacePoint x = x0;
  double from = t0;
  for (const double to : times) {
    x = integrated(motion, from, x, to);
    from = to;
  }
  return x;
}

SpacePoint Handle::velocity(double t, const SpacePoint& x) const {
  return motion ? motion->velocity(t, x) : SpacePoint(SpacePoint::Zero(x.size()));
}

bool Handle::has_path(int dimension) const {
  const bool whole = std::all_of(held.begin(), held.begin() + dimension, [](bool h) { return h; });
  return !motion || whole || !motion->depends_on_place();
}

bool Handle::closed_form(int dimension) const { return !motion || (motion->closed_form() && has_path(dimension)); }

void check_handles(const std::vector<Handle>& handles, const Domain& domain) {
  const int d = domain.ambient_dimension();
  // By vertex and component, the handle that holds it.
  IndexMatrix holder = IndexMatrix::Constant(domain.vertex_count(), d, -1);
  for (std::size_t k = 0; k < handles.size(); ++k) {
    const Handle& handle = handles[k];
    const std::string name = name_of(handle, k);
    if (handle.vertices.empty()) throw DataError(name + ": the region has no vertices");
    if (handle.motion && handle.motion->dimension() != d) {
      throw DataError(fmt::format("{}: its motion is of points of {} coordinates, the mesh has {}", name,
                                  handle.motion->dimension(), d));
    }
    if (std::none_of(handle.held.begin(), handle.held.begin() + d, [](bool held) { return held; })) {
      throw DataError(name + ": no component is held");
    }
    for (std::size_t i = 0; i < handle.vertices.size(); ++i) {
      const Index v = handle.vertices[i];
      if (v < 0 || v >= domain.vertex_count()) {
        throw DataError(fmt::format("{}: vertex {} does not exist; the mesh has vertices 0 to {}", name, v,
                                    domain.vertex_count() - 1));
      }
      if (i > 0 && v <= handle.vertices[i - 1]) {
        throw DataError(
            fmt::format("{}: vertex {} after vertex {}; expected ascending numbers", name, v, handle.vertices[i - 1]));
      }
      for (int c = 0; c < d; ++c) {
        if (!handle.held[c]) continue;
        const Index other = holder(v, c);
        if (other >= 0 && handles[other].motion != handle.motion) {
          throw DataError(fmt::format("vertex {} is in {} and in {}, which move it differently", v,
                                      name_of(handles[other], other), name));
        }
        holder(v, c) = static_cast<Index>(k);
      }
    }
  }
}

std::vector<double> breaks_of(const std::vector<Handle>& handles, double t0, double t1) {
  std::vector<double> times;
  for (const Handle& handle : handles) {
    if (!handle.motion) continue;
    const std::vector<double> more = handle.motion->breaks(t0, t1);
    times.insert(times.end(), more.begin(), more.end());
  }
  return inside(std::move(times), t0, t1);
}

Matrix handle_positions(const std::vector<Handle>& handles, const Matrix& positions, double t0, double t) {
  Matrix result = positions;
  const auto d = static_cast<int>(positions.cols());
  for (std::size_t k = 0; k < handles.size(); ++k) {
    const Handle& handle = handles[k];
    if (!handle.motion) continue;
    if (!handle.has_path(d)) {
      throw UsageError(name_of(handle, k) + ": where it goes depends on the components that are not held");
    }
    for (const Index v : handle.vertices) {
      const SpacePoint x = flow(*handle.motion, t0, positions.row(v).transpose(), t);
      for (int c = 0; c < d; ++c) {
        if (handle.held[c]) result(v, c) = x[c];
      }
    }
  }
  return result;
}

}  // namespace variform
