// RRT* of OMPL between two loiter circles over terrain, for `bench_terrain_peer.py`.
//
// The planner of Lim, Achermann, Girod, Lawrance and Siegwart, "Safe low-altitude navigation in steep terrain
// with fixed-wing aerial vehicles" (RA-L 2024), with the parts that OMPL 2 has: `RRTstar`, steps of at most
// `range` metres, and Dubins airplane paths of Owen, Beard and McLain (2014).
//
// Arguments: file of the elevation, then east, north, height of the start circle and of the goal circle, CPU
// seconds, seed, range in metres, `band` or `box`. Heights are sampled in the flight band above the sampled
// place, or anywhere in the box around the map.
// File: int32 rows, cols; float64 origin east, origin north, spacing; float64 heights, row 0 in the south.
// Output: JSON with [CPU seconds, length] of each better path, and the best path in steps of about 1 m.
// Lengths are those of the projection on the ground. CPU seconds begin after the file is read.

#include <ompl/base/goals/GoalSampleableRegion.h>
#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/spaces/OwenStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTstar.h>
#include <ompl/util/RandomNumbers.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

constexpr double kTurnRadius = 66.67;
constexpr double kPathAngle = 0.15;
constexpr double kMinAgl = 50.0;
constexpr double kMaxAgl = 120.0;
constexpr double kCheckStep = 5.0;
constexpr int kStartAngles = 36;
constexpr double kPi = 3.14159265358979323846;

double cpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

class Ground {
 public:
  explicit Ground(const std::string& name) {
    std::ifstream file(name, std::ios::binary);
    std::int32_t shape[2];
    double frame[3];
    file.read(reinterpret_cast<char*>(shape), sizeof shape);
    file.read(reinterpret_cast<char*>(frame), sizeof frame);
    if (!file || shape[0] < 2 || shape[1] < 2) throw std::runtime_error("cannot read " + name);
    rows_ = shape[0];
    cols_ = shape[1];
    east0 = frame[0];
    north0 = frame[1];
    spacing_ = frame[2];
    heights_.resize(static_cast<std::size_t>(rows_) * cols_);
    file.read(reinterpret_cast<char*>(heights_.data()), static_cast<std::streamsize>(8 * heights_.size()));
    if (!file) throw std::runtime_error(name + " is too short");
    east1 = east0 + spacing_ * (cols_ - 1);
    north1 = north0 + spacing_ * (rows_ - 1);
    const auto ends = std::minmax_element(heights_.begin(), heights_.end());
    lowest = *ends.first;
    highest = *ends.second;
  }

  // Bilinear height of the ground; NaN outside the nodes.
  double at(double east, double north) const {
    if (!(east >= east0 && east <= east1 && north >= north0 && north <= north1))
      return std::numeric_limits<double>::quiet_NaN();
    const double x = (east - east0) / spacing_;
    const double y = (north - north0) / spacing_;
    const int col = std::min(static_cast<int>(x), cols_ - 2);
    const int row = std::min(static_cast<int>(y), rows_ - 2);
    const double* south = &heights_[static_cast<std::size_t>(row) * cols_ + col];
    const double* north_row = south + cols_;
    const double u = x - col;
    const double v = y - row;
    return (1 - v) * ((1 - u) * south[0] + u * south[1]) + v * ((1 - u) * north_row[0] + u * north_row[1]);
  }

  double east0, north0, east1, north1, lowest, highest;

 private:
  int rows_, cols_;
  double spacing_;
  std::vector<double> heights_;
};

// Dubins airplane paths, with the length of their projection as the distance. (`PathType::length()` of OMPL 2.0
// adds a turn to the right with the wrong sign.)
class Airplane : public ob::OwenStateSpace {
 public:
  Airplane() : OwenStateSpace(kTurnRadius, kPathAngle) {}

  double distance(const ob::State* from, const ob::State* to) const override {
    const auto path = getPath(from, to);
    if (!path) return getMaximumExtent();
    return path->turnRadius_ * (path->path_.length() + 2 * kPi * path->numTurns_ + std::abs(path->phi_));
  }
};

using Pose = Airplane::StateType;

struct Circle {
  double east, north, height;

  // Write the pose of a vehicle on the circle, counterclockwise or clockwise.
  void pose(double angle, bool left, ob::State* state) const {
    auto& pose = *state->as<Pose>();
    pose[0] = east + kTurnRadius * std::cos(angle);
    pose[1] = north + kTurnRadius * std::sin(angle);
    pose[2] = height;
    pose.yaw() = std::remainder(angle + (left ? 0.5 : -0.5) * kPi, 2 * kPi);
  }

  // Return how far a pose is from any pose on the circle, in metres.
  double miss(const ob::State* state) const {
    const auto& pose = *state->as<Pose>();
    const double x = pose[0] - east;
    const double y = pose[1] - north;
    const double angle = std::atan2(y, x);
    const double off = std::abs(std::remainder(pose.yaw() - angle, 2 * kPi));
    const double off_tangent = std::abs(off - 0.5 * kPi);
    return std::abs(std::hypot(x, y) - kTurnRadius) + std::abs(pose[2] - height) + kTurnRadius * off_tangent;
  }
};

class EnterCircle : public ob::GoalSampleableRegion {
 public:
  EnterCircle(const ob::SpaceInformationPtr& info, Circle circle) : GoalSampleableRegion(info), circle_(circle) {
    setThreshold(1e-6);
  }
  double distanceGoal(const ob::State* state) const override { return circle_.miss(state); }
  void sampleGoal(ob::State* state) const override {
    circle_.pose(rng_.uniformReal(-kPi, kPi), rng_.uniformBool(), state);
  }
  unsigned int maxSampleCount() const override { return std::numeric_limits<unsigned int>::max(); }

 private:
  Circle circle_;
  mutable ompl::RNG rng_;
};

class InBand : public ob::StateSampler {
 public:
  InBand(const ob::StateSpace* space, const Ground& ground) : StateSampler(space), ground_(ground) {}
  void sampleUniform(ob::State* state) override {
    auto& pose = *state->as<Pose>();
    pose[0] = rng_.uniformReal(ground_.east0, ground_.east1);
    pose[1] = rng_.uniformReal(ground_.north0, ground_.north1);
    pose[2] = ground_.at(pose[0], pose[1]) + rng_.uniformReal(kMinAgl, kMaxAgl);
    pose.yaw() = rng_.uniformReal(-kPi, kPi);
  }
  void sampleUniformNear(ob::State*, const ob::State*, double) override { throw std::logic_error("not used"); }
  void sampleGaussian(ob::State*, const ob::State*, double) override { throw std::logic_error("not used"); }

 private:
  const Ground& ground_;
};

void run(char** args) {
  const Ground ground(args[1]);
  const Circle start{std::atof(args[2]), std::atof(args[3]), std::atof(args[4])};
  const Circle goal{std::atof(args[5]), std::atof(args[6]), std::atof(args[7])};
  const double limit = std::atof(args[8]);
  const double begin = cpuSeconds();

  const auto space = std::make_shared<Airplane>();
  ob::RealVectorBounds bounds(3);
  const double low[] = {ground.east0, ground.north0, ground.lowest + kMinAgl};
  const double high[] = {ground.east1, ground.north1, ground.highest + kMaxAgl};
  std::copy(low, low + 3, bounds.low.begin());
  std::copy(high, high + 3, bounds.high.begin());
  space->setBounds(bounds);
  if (std::string(args[11]) == "band")
    space->setStateSamplerAllocator(
        [&ground](const ob::StateSpace* of) { return std::make_shared<InBand>(of, ground); });

  og::SimpleSetup setup(space);
  const auto info = setup.getSpaceInformation();
  info->setStateValidityCheckingResolution(kCheckStep / space->getMaximumExtent());
  setup.setStateValidityChecker([&ground](const ob::State* state) {
    const auto& pose = *state->as<Pose>();
    const double agl = pose[2] - ground.at(pose[0], pose[1]);
    return agl >= kMinAgl && agl <= kMaxAgl;  // NaN is neither
  });
  for (int i = 0; i < 2 * kStartAngles; ++i) {
    ob::ScopedState<> pose(space);
    start.pose(kPi * (i / 2) * 2 / kStartAngles, i % 2 == 0, pose.get());
    setup.addStartState(pose);
  }
  setup.setGoal(std::make_shared<EnterCircle>(info, goal));
  setup.setOptimizationObjective(std::make_shared<ob::PathLengthOptimizationObjective>(info));
  const auto planner = std::make_shared<og::RRTstar>(info);
  planner->setRange(std::atof(args[10]));
  setup.setPlanner(planner);

  std::vector<std::pair<double, double>> better;
  setup.getProblemDefinition()->setIntermediateSolutionCallback(
      [&](const ob::Planner*, const std::vector<const ob::State*>&, const ob::Cost cost) {
        better.emplace_back(cpuSeconds() - begin, cost.value());
      });
  setup.solve(ob::PlannerTerminationCondition([&] { return cpuSeconds() - begin > limit; }));

  std::printf("{\"cpu_s\": %.3f, \"iterations\": %u, ", cpuSeconds() - begin, planner->numIterations());
  std::printf("\"solutions\": [");
  for (std::size_t i = 0; i < better.size(); ++i)
    std::printf("%s[%.4f, %.3f]", i ? ", " : "", better[i].first, better[i].second);
  std::printf("], \"path_m\": [");
  if (setup.haveExactSolutionPath()) {
    const auto& states = setup.getSolutionPath().getStates();
    ob::ScopedState<> at(space);
    for (std::size_t leg = 0; leg + 1 < states.size(); ++leg) {
      const int steps = std::max(1, static_cast<int>(std::ceil(space->distance(states[leg], states[leg + 1]))));
      for (int k = leg ? 1 : 0; k <= steps; ++k) {
        space->interpolate(states[leg], states[leg + 1], static_cast<double>(k) / steps, at.get());
        const auto& pose = *at.get()->as<Pose>();
        std::printf("%s[%.6f, %.6f, %.6f]", leg + k ? ", " : "", pose[0], pose[1], pose[2]);
      }
    }
  }
  std::printf("]}\n");
}

}  // namespace

int main(int count, char** args) {
  if (count != 12) {
    std::fprintf(stderr, "12 arguments, see the head of main.cpp\n");
    return 2;
  }
  ompl::msg::setLogLevel(ompl::msg::LOG_ERROR);
  ompl::RNG::setSeed(std::strtoul(args[9], nullptr, 10) + 1);
  try {
    run(args);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
