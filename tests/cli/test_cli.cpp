// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <random>
#include <regex>
#include <sstream>
#include <thread>

#include "energies/energies.h"
#include "experiments/pipelines.h"
#include "framework/experiment/domain_source.h"
#include "framework/form/norm.h"
#include "integrators/ode/ode_backends.h"
#include "solvers/eigen/eigen_backends.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

/// A process of the command line program with its output in files.
class Process {
 public:
  Process(const std::vector<std::string>& arguments, const fs::path& folder)
      : out_(folder / "stdout.txt"), err_(folder / "stderr.txt") {
    std::vector<std::string> words = {VARIFORM_CLI};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const int out = open(out_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    const int err = open(err_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    pid_ = fork();
    if (pid_ == 0) {
      dup2(out, STDOUT_FILENO);
      dup2(err, STDERR_FILENO);
      execv(argv[0], argv.data());
      _exit(127);
    }
    close(out);
    close(err);
  }

  void signal(int number) const { kill(pid_, number); }
  /// Exit code; minus the number of the signal that killed the process.
  int wait() const {
    int status = 0;
    waitpid(pid_, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  std::string out() const { return content_of(out_); }
  std::string err() const { return content_of(err_); }

 private:
  fs::path out_;
  fs::path err_;
  pid_t pid_ = -1;
};

/// Each test has an empty folder; "{}" in arguments stands for it.
class Cli : public ::testing::Test {
 protected:
  struct Result {
    int code;
    std::string out;
    std::string err;
  };

  fs::path at(const std::string& name) const { return folder_ / name; }

  void write(const std::string& name, const std::string& content) const {
    fs::create_directories(at(name).parent_path());
    std::ofstream(at(name), std::ios::binary) << content;
  }

  Process start(std::vector<std::string> arguments) const {
    for (std::string& argument : arguments) {
      for (std::size_t i = argument.find("{}"); i != std::string::npos; i = argument.find("{}", i)) {
        argument.replace(i, 2, folder_.path().string());
      }
    }
    return {arguments, folder_.path()};
  }

  Result call(const std::vector<std::string>& arguments) const {
    const Process process = start(arguments);
    const int code = process.wait();
    const Result result{code, process.out(), process.err()};
    EXPECT_GE(code, 0) << "killed by a signal\n" << result.err;
    EXPECT_THAT(result.err, Not(HasSubstr("terminate called")));
    return result;
  }

  /// run {}/study.toml --out {}/out, without pictures.
  Result run_study(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"run", "{}/study.toml", "--out", "{}/out", "--no-figures"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return call(arguments);
  }

  nlohmann::json record(const std::string& out = "out") const {
    return nlohmann::json::parse(content_of(at(out + "/record.json")));
  }

 private:
  TemporaryFolder folder_;
};

/// Sixteen squares of two triangles each; the left side is moved a little.
const std::string kStudy = R"(pipeline = "deform"
[domain]
generator = "square"
h = 0.25
[energy]
type = "asap"
[norm]
beta = 0.2
[[constraint]]
kind = "hard"
vertices = [0, 5]
move = [0.1, 0.05]
[[constraint]]
kind = "hard"
vertices = [24]
)";

/// Two by two squares with vertices in no particular order.
const std::string kMesh = R"(v 2 2 0
v 0 0 0
v 1 1 0
v 2 0 0
v 0 2 0
v 1 0 0
v 0 1 0
v 1 2 0
v 2 1 0
f 2 6 3
f 2 3 7
f 6 4 9
f 6 9 3
f 7 3 8
f 7 8 5
f 3 9 1
f 3 1 8
)";

struct ObjMesh {
  std::vector<Eigen::Vector2d> vertices;
  std::vector<std::array<int, 3>> triangles;
};

ObjMesh read_obj(const std::string& text) {
  ObjMesh mesh;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "v") {
      Eigen::Vector2d x;
      words >> x[0] >> x[1];
      mesh.vertices.push_back(x);
    } else if (kind == "f") {
      std::array<int, 3> t{};
      words >> t[0] >> t[1] >> t[2];
      mesh.triangles.push_back(t);
    }
  }
  return mesh;
}

/// The energy of ARAP and the count of flipped triangles, from nothing but the two meshes.
std::pair<double, int> arap_energy(const ObjMesh& rest, const ObjMesh& deformed) {
  double energy = 0.0;
  int flipped = 0;
  for (const auto& t : rest.triangles) {
    const auto edges = [&t](const ObjMesh& mesh) {
      Eigen::Matrix2d E;
      for (int i = 0; i < 2; ++i) E.col(i) = mesh.vertices[t[i + 1] - 1] - mesh.vertices[t[0] - 1];
      return E;
    };
    const Eigen::Matrix2d F = edges(deformed) * edges(rest).inverse();
    const Eigen::JacobiSVD<Eigen::Matrix2d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix2d R = svd.matrixU() * svd.matrixV().transpose();
    if (R.determinant() < 0.0) {
      Eigen::Matrix2d U = svd.matrixU();
      U.col(1) *= -1.0;
      R = U * svd.matrixV().transpose();
    }
    energy += 0.5 * edges(rest).determinant() * (F - R).squaredNorm();
    flipped += F.determinant() <= 0.0;
  }
  return {energy, flipped};
}

TEST_F(Cli, ARunWritesRowsAndMeshesAsTheContractSays) {
  write("mesh.obj", kMesh);
  write("study.toml", R"(title = "contract"
pipeline = "deform"
[domain]
mesh = "mesh.obj"
[energy]
type = "arap"
[solver]
tolerance = 1e-12
max_iterations = 5000
[[constraint]]
kind = "hard"
vertices = [1, 6, 4]
[[constraint]]
kind = "hard"
vertices = [0, 8]
positions = [[2.5, 2.25], [2.625, 1]]
[[constraint]]
kind = "hard"
vertices = [3]
move = [0.5, -0.25]
[sweep]
"norm.beta" = [0.0, 0.3]
"norm.facet_weight" = ["facet_measure", "finite_volume"]
)");
  const Result result = run_study({"--set", "title=contracted"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.err, "");

  const nlohmann::json json = record();
  EXPECT_EQ(json["title"], "contracted");
  EXPECT_EQ(json["pipeline"], "deform");
  EXPECT_THAT(json["config"].get<std::string>(), HasSubstr("title = \"contracted\""));
  EXPECT_TRUE(json["provenance"].contains("variform"));
  EXPECT_TRUE(json["warnings"].empty()) << json["warnings"];
  ASSERT_EQ(json["rows"].size(), 4u);

  const ObjMesh rest = read_obj(kMesh);
  for (std::size_t i = 0; i < 4; ++i) {
    const nlohmann::json& row = json["rows"][i];
    for (const auto& [key, value] : row.items()) EXPECT_FALSE(value.is_structured()) << key << " is not flat";
    EXPECT_EQ(row["norm.beta"], i < 2 ? 0.0 : 0.3);
    EXPECT_EQ(row["norm.facet_weight"], i % 2 == 0 ? "facet_measure" : "finite_volume");
    EXPECT_EQ(row["vertices"], 9);
    EXPECT_EQ(row["cells"], 8);
    EXPECT_TRUE(row["iterations"].is_number_integer());
    EXPECT_GT(row["iterations"], 1);
    EXPECT_EQ(row["converged"], true);
    EXPECT_LT(row["solver_residual"], 1e-10);
    for (const char* phase : {"declare", "pattern", "refill", "analyze", "factorize", "solve", "total"}) {
      EXPECT_GE(row["seconds_" + std::string(phase)], 0.0) << phase;
    }

    ASSERT_TRUE(row["mesh"].is_string());
    const fs::path path = at("out") / row["mesh"].get<std::string>();
    EXPECT_EQ(path.extension(), ".obj");
    const ObjMesh deformed = read_obj(content_of(path));
    EXPECT_EQ(deformed.triangles, rest.triangles);
    ASSERT_EQ(deformed.vertices.size(), 9u);
    for (const int v : {1, 6, 4}) EXPECT_EQ(deformed.vertices[v], rest.vertices[v]);
    EXPECT_EQ(deformed.vertices[0], Eigen::Vector2d(2.5, 2.25));
    EXPECT_EQ(deformed.vertices[8], Eigen::Vector2d(2.625, 1.0));
    EXPECT_EQ(deformed.vertices[3], Eigen::Vector2d(2.5, -0.25));
    for (const int v : {2, 5, 7}) EXPECT_GT((deformed.vertices[v] - rest.vertices[v]).norm(), 0.05) << "free vertex";
    const auto [energy, flipped] = arap_energy(rest, deformed);
    EXPECT_NEAR(row["energy"], energy, 1e-9 * energy);
    EXPECT_EQ(row["flipped"], flipped);
    const double beta = row["norm.beta"];
    const double blend = (1.0 - beta) * row["energy"].get<double>() + beta * row["energy_R"].get<double>();
    EXPECT_NEAR(row["energy_W"], blend, 1e-12 * blend);
  }
  EXPECT_NE(json["rows"][0]["mesh"], json["rows"][1]["mesh"]);
  for (const char* file : {"table.csv", "table.md", "table.tex", "table.json", "report.html"}) {
    EXPECT_TRUE(fs::exists(at("out") / file)) << file;
  }
}

/// A file with positions in space, texture coordinates and faces (corners as "v" or "v/vt").
struct SurfaceFile {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector2d> texture;
  std::vector<std::array<int, 3>> triangles;  ///< of vertices, from 0
  std::vector<std::array<int, 3>> charts;     ///< of texture coordinates, from 0; -1 without
};

SurfaceFile read_surface(const std::string& text) {
  SurfaceFile file;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "v") {
      Eigen::Vector3d x;
      words >> x[0] >> x[1] >> x[2];
      file.vertices.push_back(x);
    } else if (kind == "vt") {
      Eigen::Vector2d x;
      words >> x[0] >> x[1];
      file.texture.push_back(x);
    } else if (kind == "f") {
      std::array<int, 3> t{};
      std::array<int, 3> c{};
      for (int i = 0; i < 3; ++i) {
        std::string corner;
        words >> corner;
        const std::size_t slash = corner.find('/');
        t[i] = std::stoi(corner.substr(0, slash)) - 1;
        c[i] = slash == std::string::npos ? -1 : std::stoi(corner.substr(slash + 1)) - 1;
      }
      file.triangles.push_back(t);
      file.charts.push_back(c);
    }
  }
  return file;
}

/// Area of a triangle in space and its edges from the first corner in an orthonormal frame of its plane, by columns.
std::pair<double, Eigen::Matrix2d> flattened(const SurfaceFile& file, const std::array<int, 3>& t) {
  const Eigen::Vector3d a = file.vertices[t[1]] - file.vertices[t[0]];
  const Eigen::Vector3d b = file.vertices[t[2]] - file.vertices[t[0]];
  Eigen::Matrix2d E;
  E << a.norm(), a.dot(b) / a.norm(), 0.0, a.cross(b).norm() / a.norm();
  return {0.5 * a.cross(b).norm(), E};
}

/// A tent of six triangles over a hexagon-like outline, rest of the surface tests.
const std::string kTent = R"(v 0 0 0.5
v 1 0 0
v 0.5 0.9 0.1
v -0.5 0.8 0
v -1 0 0.1
v -0.6 -0.9 0
v 0.5 -0.8 0.05
v 0.3 0.2 0.4
f 8 2 3
f 8 3 1
f 8 1 2
f 1 3 4
f 1 4 5
f 1 5 6
f 1 6 7
f 1 7 2
)";

/// On a surface ARAP costs, per triangle, the squared distances of the two singular values from 1.
TEST_F(Cli, ASurfaceDeformsAtTheEnergyThatItsMeshesHave) {
  write("mesh.obj", kTent);
  write("study.toml", R"(pipeline = "deform"
[domain]
mesh = "mesh.obj"
[energy]
type = "arap"
[solver]
tolerance = 1e-13
max_iterations = 20000
[[constraint]]
kind = "hard"
vertices = [1, 2, 3, 4, 5, 6]
[[constraint]]
kind = "hard"
vertices = [0]
move = [0.2, 0.1, 0.4]
[sweep]
"norm.beta" = [0.0, 0.3]
)");
  const Result result = run_study();
  ASSERT_EQ(result.code, 0) << result.err;
  const SurfaceFile rest = read_surface(kTent);
  const nlohmann::json rows = record()["rows"];
  for (const auto& row : rows) {
    EXPECT_EQ(row["converged"], true);
    const SurfaceFile deformed = read_surface(content_of(at("out") / row["mesh"].get<std::string>()));
    ASSERT_EQ(deformed.triangles, rest.triangles);
    EXPECT_LT((deformed.vertices[0] - Eigen::Vector3d(0.2, 0.1, 0.9)).norm(), 1e-15);
    double energy = 0.0;
    double total = 0.0;
    for (const auto& t : rest.triangles) {
      const auto [area, E] = flattened(rest, t);
      Eigen::Matrix<double, 3, 2> D;
      for (int i = 0; i < 2; ++i) D.col(i) = deformed.vertices[t[i + 1]] - deformed.vertices[t[0]];
      const Eigen::Vector2d sigma = Eigen::JacobiSVD<Eigen::MatrixXd>(D * E.inverse()).singularValues();
      energy += area * (sigma.array() - 1.0).square().sum();
      total += area;
    }
    EXPECT_GT(energy, 0.01);
    EXPECT_NEAR(row["energy"], energy, 1e-9 * energy);
    EXPECT_NEAR(row["E_isom"], energy / total, 1e-9 * energy);
  }
  EXPECT_GT(record()["rows"][1]["energy"], record()["rows"][0]["energy"]);
  EXPECT_LT(record()["rows"][1]["energy_R"], record()["rows"][0]["energy_R"]);
}

/// Texture coordinates in the OBJ file are the map: pins are where they were put, the energy is that of signed singular
/// values, |s1 - s2|^2 for LSCM and (s1 - 1)^2 + (s2 - 1)^2 for ARAP.
TEST_F(Cli, AParametrizationIsTheTextureOfItsObjFile) {
  write("mesh.obj", kTent);
  write("study.toml", R"(pipeline = "parametrize"
[domain]
mesh = "mesh.obj"
[energy]
type = "lscm"
[solver]
tolerance = 1e-13
max_iterations = 20000
[[constraint]]
kind = "hard"
vertices = [1, 4, 0]
positions = [[1.2, 0], [-1, 0.1], [0.4, 0.3]]
[sweep]
"energy.type" = ["lscm", "arap_parametrization"]
"norm.beta" = [0.0, 0.3]
)");
  const Result result = run_study();
  ASSERT_EQ(result.code, 0) << result.err;
  const SurfaceFile rest = read_surface(kTent);
  const std::map<int, Eigen::Vector2d> pins = {{1, {1.2, 0.0}}, {4, {-1.0, 0.1}}, {0, {0.4, 0.3}}};
  const nlohmann::json rows = record()["rows"];
  for (const auto& row : rows) {
    SCOPED_TRACE(row["energy.type"]);
    const bool conformal = row["energy.type"] == "lscm";
    const SurfaceFile mapped = read_surface(content_of(at("out") / row["mesh"].get<std::string>()));
    EXPECT_EQ(mapped.vertices, rest.vertices) << "the surface is as it was";
    ASSERT_EQ(mapped.triangles, rest.triangles);
    ASSERT_EQ(mapped.texture.size(), rest.vertices.size());
    double energy = 0.0;
    double total = 0.0;
    int flipped = 0;
    for (std::size_t k = 0; k < rest.triangles.size(); ++k) {
      const auto [area, E] = flattened(rest, rest.triangles[k]);
      const std::array<int, 3>& c = mapped.charts[k];
      Eigen::Matrix2d D;
      for (int i = 0; i < 2; ++i) D.col(i) = mapped.texture[c[i + 1]] - mapped.texture[c[0]];
      for (int i = 0; i < 3; ++i) {
        const auto pin = pins.find(rest.triangles[k][i]);
        if (pin == pins.end()) continue;
        EXPECT_LT((mapped.texture[c[i]] - pin->second).norm(), 1e-12);
      }
      const Eigen::Matrix2d J = D * E.inverse();
      Eigen::Vector2d sigma = Eigen::JacobiSVD<Eigen::MatrixXd>(J).singularValues();
      if (J.determinant() < 0.0) sigma[1] = -sigma[1];
      energy += area * (conformal ? std::pow(sigma[0] - sigma[1], 2) : (sigma.array() - 1.0).square().sum());
      total += area;
      flipped += J.determinant() <= 0.0;
    }
    EXPECT_GT(energy, 0.01);
    EXPECT_NEAR(row["energy"], energy, 1e-8 * energy);
    EXPECT_NEAR(row[conformal ? "E_conf" : "E_isom"], (conformal ? 0.5 : 1.0) * energy / total, 1e-8 * energy);
    EXPECT_EQ(row["flipped"], flipped);
    EXPECT_EQ(row["hard_error"], 0.0);
  }
}

/// A closed surface cut open: the file has the surface before the cut, and more texture coordinates than vertices.
TEST_F(Cli, ACutSurfaceIsWrittenWithItsSeamInTheTexture) {
  write("study.toml", R"(pipeline = "parametrize"
[domain]
generator = "sphere"
h = 0.5
[domain.cut]
path = [0, 20, 30]
[energy]
type = "arap_parametrization"
[solver]
nonlinear = "gauss_newton"
[norm]
beta = 0.1
[parametrization]
initial = "tutte"
)");
  const Result result = run_study();
  ASSERT_EQ(result.code, 0) << result.err;
  const nlohmann::json row = record()["rows"][0];
  const SurfaceFile file = read_surface(content_of(at("out") / row["mesh"].get<std::string>()));
  EXPECT_GT(file.texture.size(), file.vertices.size());
  EXPECT_EQ(file.texture.size(), row["vertices"]);
  for (const auto& x : file.vertices) EXPECT_NEAR(x.norm(), 1.0, 1e-12);
  // Closed: as many edges as V + F - 2 when corners are told apart by vertex.
  EXPECT_EQ(2 * (file.vertices.size() - 2), file.triangles.size());
}

/// The Killing energy is |J + J'|^2, with the velocity taken from nothing but the file of the moved mesh; rigid
/// velocities at the handles are carried on without energy.
TEST_F(Cli, AVelocityFieldHasTheEnergyOfTheMotionThatItMakes) {
  write("mesh.obj", kMesh);
  write("study.toml", R"(pipeline = "vector_field"
[domain]
mesh = "mesh.obj"
[energy]
type = "akvf"
[flow]
step = 0.25
[[constraint]]
kind = "hard"
vertices = [1, 6, 4]
[[constraint]]
kind = "hard"
vertices = [3, 8]
velocity = [0.5, 1.0]
[sweep]
"norm.beta" = [0.0, 0.3]
)");
  const Result result = run_study();
  ASSERT_EQ(result.code, 0) << result.err;
  const ObjMesh rest = read_obj(kMesh);
  const nlohmann::json rows = record()["rows"];
  for (const auto& row : rows) {
    const ObjMesh moved = read_obj(content_of(at("out") / row["mesh"].get<std::string>()));
    double energy = 0.0;
    double speed = 0.0;
    for (const auto& t : rest.triangles) {
      Eigen::Matrix2d X;
      Eigen::Matrix2d V;
      for (int i = 0; i < 2; ++i) {
        X.col(i) = rest.vertices[t[i + 1] - 1] - rest.vertices[t[0] - 1];
        V.col(i) = (moved.vertices[t[i + 1] - 1] - moved.vertices[t[0] - 1] - X.col(i)) / 0.25;
      }
      const Eigen::Matrix2d J = V * X.inverse();
      energy += 0.5 * X.determinant() * (J + J.transpose()).squaredNorm();
    }
    for (std::size_t v = 0; v < rest.vertices.size(); ++v) {
      speed = std::max(speed, (moved.vertices[v] - rest.vertices[v]).norm() / 0.25);
    }
    EXPECT_NEAR(row["energy"], energy, 1e-10 * energy);
    EXPECT_NEAR(row["speed_max"], speed, 1e-12);
    EXPECT_LT((moved.vertices[3] - rest.vertices[3] - 0.25 * Eigen::Vector2d(0.5, 1.0)).norm(), 1e-14);
    EXPECT_EQ(row["hard_error"], 0.0);
  }
  const Result rigid = run_study({"--set",
                                  "constraint=[{ kind = \"hard\", vertices = [1, 3, 4], velocity = "
                                  "{ translate = [0.5, 0.0], rotate = 90, about = [1.0, 1.0] } }]"});
  ASSERT_EQ(rigid.code, 0) << rigid.err;
  const nlohmann::json again = record()["rows"];
  for (const auto& row : again) {
    EXPECT_LT(row["energy"], 1e-25);
    // At (2, 2) and (0, 2), say: pi/2 times the distance sqrt(2), and the translation, at its fastest corner.
    const double omega = std::acos(-1.0) / 2.0;
    EXPECT_NEAR(row["speed_max"], std::hypot(omega + 0.5, omega), 1e-12);
  }
}

/// Results of tetrahedra go to files that hold tetrahedra, and a search may ask for what the constraints missed.
TEST_F(Cli, TetrahedraAreWrittenAsTetrahedra) {
  write("study.toml", R"(pipeline = "deform"
[domain]
generator = "cube_tet"
h = 0.5
[energy]
type = "arap"
[norm]
beta = "auto"
[norm.auto]
until = "soft_error < 0.03"
[[constraint]]
kind = "hard"
select = { box = [0, 0, 0, 1, 1, 0] }
[[constraint]]
kind = "soft"
weight = 1.0
select = { near = [1, 1, 1] }
move = [0.1, 0.1, 0.1]
)");
  const Result result = run_study();
  ASSERT_EQ(result.code, 0) << result.err;
  const nlohmann::json row = record()["rows"][0];
  EXPECT_EQ(row["mesh"], "meshes/point-0000.mesh");
  const std::string file = content_of(at("out") / row["mesh"].get<std::string>());
  EXPECT_THAT(file, HasSubstr(fmt::format("Tetrahedra\n{}\n", row["cells"].get<int>())));
  EXPECT_LT(row["soft_error"], 0.03);
  EXPECT_GT(row["beta_low"], 0.0);
  EXPECT_GT(row["soft_error"], 0.028) << "the smallest beta that does it";
  EXPECT_EQ(row["beta_found"], true);
  EXPECT_EQ(run_study({"--resume"}).code, 0);
}

TEST_F(Cli, RunPrintsTheTableUnlessQuiet) {
  write("study.toml", kStudy);
  const Result result = run_study();
  EXPECT_THAT(result.out, HasSubstr("| vertices"));
  EXPECT_THAT(result.out, HasSubstr("report.html"));
  EXPECT_EQ(run_study({"--quiet"}).out, "");
}

TEST_F(Cli, RunDrawsTheDeformedMesh) {
  write("study.toml", kStudy);
  const Result result = call({"run", "{}/study.toml", "--out", "{}/out", "--quiet"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.err, "");
  ASSERT_EQ(record()["figures"].size(), 1u);
  const std::string path = record()["figures"][0]["path"];
  EXPECT_THAT(content_of(at("out/" + path + ".svg")), HasSubstr("<svg"));
  EXPECT_THAT(content_of(at("out/" + path + ".png")), HasSubstr("PNG"));
}

TEST_F(Cli, SetReplacesValuesAndVertexOrderIsThatOfTheMesh) {
  write("study.toml", kStudy);
  ASSERT_EQ(run_study({"--set", "norm.beta=0.5", "--set", "energy.type=larap", "--set", "domain.h=0.5"}).code, 3)
      << "vertex 24 is gone";
  ASSERT_EQ(
      run_study({"--set", "norm.beta=0.5", "--set", "energy.type=larap", "--set", "constraint[1].vertices=[20]"}).code,
      0);
  EXPECT_EQ(record()["rows"][0]["beta"], 0.5);
  EXPECT_THAT(record()["config"].get<std::string>(), HasSubstr("type = \"larap\""));
}

/// The mesh with an unused vertex in front and one in the middle, and constraints by its own numbers.
TEST_F(Cli, VertexNumbersAreThoseOfTheFileWhateverIsDropped) {
  std::string mesh = "v 9 9 0\n" + kMesh;
  for (std::size_t line = mesh.find("\nf "); line != std::string::npos; line = mesh.find("\nf ", line + 1)) {
    std::istringstream corners(mesh.substr(line + 3, mesh.find('\n', line + 1) - line - 3));
    int a = 0;
    int b = 0;
    int c = 0;
    corners >> a >> b >> c;
    mesh.replace(line + 3, mesh.find('\n', line + 1) - line - 3, fmt::format("{} {} {}", a + 1, b + 1, c + 1));
  }
  write("mesh.obj", mesh);
  // Vertices 2 and 4 (from 0) of the file are (0, 0) and (2, 0).
  const std::string study = R"(pipeline = "deform"
domain = { mesh = "mesh.obj" }
energy = { type = "arap" }
solver = { tolerance = 1e-12 }
[[constraint]]
kind = "hard"
vertices = [2, 4]
positions = [[0.25, 0.5], [2.25, 0.5]]
)";
  write("study.toml", study);
  ASSERT_EQ(run_study().code, 0);
  const ObjMesh rest = read_obj(mesh);
  const ObjMesh result = read_obj(content_of(at("out/meshes/point-0000.obj")));
  ASSERT_EQ(result.vertices.size(), 10U);
  EXPECT_EQ(result.vertices[0], rest.vertices[0]) << "dropped, at rest";
  for (std::size_t v = 1; v < 10; ++v) {
    EXPECT_LT((result.vertices[v] - rest.vertices[v] - Eigen::Vector2d(0.25, 0.5)).norm(), 1e-5) << v;
  }
  EXPECT_EQ(result.triangles, rest.triangles);
  const Result dropped = run_study({"--set", "constraint[0].vertices=[0, 4]"});
  EXPECT_EQ(dropped.code, 3);
  EXPECT_THAT(dropped.err, HasSubstr("vertex 0 belongs to no cell"));
}

TEST_F(Cli, AMeshFlatInAnotherPlaneComesBackInThatPlane) {
  std::string mesh;
  std::istringstream lines(kMesh);
  for (std::string line; std::getline(lines, line);) {
    double x = 0.0;
    double y = 0.0;
    if (std::sscanf(line.c_str(), "v %lf %lf", &x, &y) == 2) line = fmt::format("v {} 7 {}", x, y);
    mesh += line + "\n";
  }
  write("mesh.obj", mesh);
  write("study.toml", R"(pipeline = "deform"
domain = { mesh = "mesh.obj" }
energy = { type = "arap" }
solver = { tolerance = 1e-12 }
[[constraint]]
kind = "hard"
vertices = [1, 3]
move = [0.5, 0.25]
)");
  ASSERT_EQ(run_study().code, 0);
  std::istringstream result(content_of(at("out/meshes/point-0000.obj")));
  int vertices = 0;
  for (std::string line; std::getline(result, line);) {
    double x = 0.0;
    double y = 0.0;
    double z = 0.0;
    if (std::sscanf(line.c_str(), "v %lf %lf %lf", &x, &y, &z) != 3) continue;
    EXPECT_EQ(y, 7.0);
    EXPECT_NEAR(x - 0.5, std::round(x - 0.5), 1e-5);
    EXPECT_NEAR(z - 0.25, std::round(z - 0.25), 1e-5);
    ++vertices;
  }
  EXPECT_EQ(vertices, 9);
}

TEST_F(Cli, AValueGivenByHandIsNotSwept) {
  write("study.toml", kStudy + "[sweep]\n\"norm.beta\" = [0, 0.2]\n\"energy.type\" = [\"asap\", \"larap\"]\n");
  for (const std::string value : {"norm.beta=0.5", " norm.beta = 0.5 ", "norm={ beta = 0.5 }"}) {
    ASSERT_EQ(run_study({"--set", value}).code, 0);
    const nlohmann::json written = record();
    ASSERT_EQ(written["rows"].size(), 2U) << value;
    for (const auto& row : written["rows"]) EXPECT_EQ(row["beta"], 0.5) << value;
  }
}

/// What the project ships runs, and says of its claims what the documentation says.
TEST_F(Cli, ShippedExperimentsHoldTheirClaims) {
  const std::string folder = VARIFORM_SOURCE_DIR "/experiments/smoothed_energies/";
  for (const std::string name :
       {"demo", "benchmark-p1-square", "benchmark-p4-p1", "benchmark-s2-rest", "benchmark-l1-lscm", "benchmark-v1-tet",
        "benchmark-k-energies", "figure-51a", "sweep-scale"}) {
    const Result result = call({"reproduce", folder + name + ".toml", "--out", "{}/out", "--no-figures", "--quiet"});
    EXPECT_EQ(result.code, 0) << name << "\n" << result.out << result.err;
  }
}

/// Where the real meshes are at hand (VARIFORM_DATA), the main job runs on them; elsewhere it says that it skips them.
TEST_F(Cli, RealMeshesRunWhereTheyAre) {
  const std::string folder = VARIFORM_SOURCE_DIR "/experiments/smoothed_energies/";
  for (const std::string name : {"real-woody", "real-lego", "real-kangaroo", "real-hele-shaw", "real-annulus",
                                 "real-snail", "real-octopus-tet"}) {
    const Result result = call({"reproduce", folder + name + ".toml", "--out", "{}/out", "--no-figures", "--set",
                                "sweep={ \"norm.beta\" = [0.2, 0.4] }"});
    EXPECT_EQ(result.code, 0) << name << "\n" << result.out << result.err;
    const bool there = fs::exists(at("out/smoothed_energies/" + name + "/record.json"));
    EXPECT_THAT(result.out, HasSubstr(there ? "holds" : "skipped"));
    if (std::getenv("VARIFORM_DATA") == nullptr) {
      EXPECT_FALSE(there) << name;
    }
  }
}

TEST_F(Cli, EveryEnergyThatFitsRuns) {
  write("study.toml", kStudy);
  for (const EnergyEntry& entry : energies().entries()) {
    const Result result = run_study({"--quiet", "--set", "energy.type=" + entry.name});
    EXPECT_TRUE(result.code == 0 || (result.code == 2 && result.err.find("error: ") == 0))
        << entry.name << " ends with " << result.code << ": " << result.err;
  }
}

TEST_F(Cli, VersionTellsLicenceAndBlas) {
  const Result result = call({"--version"});
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.out, StartsWith("variform " VARIFORM_TEST_VERSION "\n"));
  EXPECT_THAT(result.out, HasSubstr("licence of this binary: "));
  EXPECT_THAT(result.out, HasSubstr("BLAS: "));
}

TEST_F(Cli, ListShowsEverythingThatIsRegistered) {
  const Result result = call({"list"});
  EXPECT_EQ(result.code, 0);
  const auto expect_listed = [&](const std::string& name) {
    EXPECT_TRUE(std::regex_search(result.out, std::regex("(^|\n) +" + name + "(\\s|$)"))) << name;
  };
  for (const std::string& name : energies().names()) expect_listed(name);
  for (const std::string& name : linear_backends().names()) expect_listed(name);
  for (const std::string& name : nonlinear_backends().names()) expect_listed(name);
  for (const std::string& name : eigen_backends().names()) expect_listed(name);
  for (const OdeBackendEntry& entry : ode_backends().entries()) {
    expect_listed(entry.name);
    for (const Parameter& parameter : entry.parameters) expect_listed(parameter.name);
  }
  for (const std::string& name : generators().names()) expect_listed(name);
  for (const std::string& name : facet_weight_names()) expect_listed(name);
  for (const PipelineEntry& entry : pipelines().entries()) {
    expect_listed(entry.name);
    for (const Metric& metric : entry.metrics) expect_listed(metric.column.key);
    for (const Section& section : entry.parameters) {
      for (const Parameter& parameter : section.parameters) expect_listed(parameter.name);
    }
  }
  EXPECT_THAT(call({"list", "energies"}).out, Not(HasSubstr("generators")));
  EXPECT_THAT(call({"list", "metrics"}).out, HasSubstr("solver_residual"));
}

TEST_F(Cli, ListNamesEveryMetricOfARow) {
  write("study.toml", kStudy);
  ASSERT_EQ(run_study().code, 0);
  std::vector<std::string> metrics = {"status", "mesh"};
  for (const Metric& metric : pipelines().find("deform").metrics) metrics.push_back(metric.column.key);
  const nlohmann::json row = record()["rows"][0];
  EXPECT_GT(row.size(), 20u);
  for (const auto& [key, value] : row.items()) EXPECT_THAT(metrics, Contains(key));
}

TEST_F(Cli, InfoTellsFactsOfAMesh) {
  write("mesh.obj", kMesh);
  const Result result = call({"info", "{}/mesh.obj"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("9 vertices, 8 triangles"));
  EXPECT_THAT(result.out, HasSubstr("domain: planar, 1 component, 8 interior facets, 8 boundary facets"));
  EXPECT_THAT(result.out, HasSubstr("Euler characteristic: 1"));
  EXPECT_THAT(result.out, HasSubstr("measure: 4;"));
}

TEST_F(Cli, DoctorTriesEveryBackend) {
  const Result result = call({"doctor"});
  EXPECT_EQ(result.code, 0);
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    EXPECT_THAT(result.out, HasSubstr(entry.name + (entry.available ? ": works" : ": not in this build")));
  }
  for (const EigenBackendEntry& entry : eigen_backends().entries()) {
    EXPECT_THAT(result.out, HasSubstr(entry.name + (entry.available ? ": works" : ": not in this build")));
  }
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    EXPECT_THAT(result.out, HasSubstr(entry.name + (entry.available ? ": works" : ": not in this build")));
  }
  for (const OdeBackendEntry& entry : ode_backends().entries()) {
    EXPECT_THAT(result.out, HasSubstr(entry.name + (entry.available ? ": works" : ": not in this build")));
  }
  EXPECT_THAT(result.out, HasSubstr("gnuplot: "));
}

TEST_F(Cli, HelpEndsWell) {
  EXPECT_EQ(call({"--help"}).code, 0);
  EXPECT_THAT(call({"run", "--help"}).out, HasSubstr("--set"));
}

TEST_F(Cli, SweepRunsOverAGrid) {
  write("study.toml", kStudy);
  const Result result = call({"sweep", "{}/study.toml", "--out", "{}/out", "--no-figures", "--quiet", "--grid",
                              "energy.type=[\"asap\", \"larap\"]", "--grid", "norm.beta=[0, 0.2, 0.4]"});
  EXPECT_EQ(result.code, 0) << result.err;
  const nlohmann::json rows = record()["rows"];
  ASSERT_EQ(rows.size(), 6u);
  EXPECT_EQ(rows[4]["energy.type"], "larap");
  EXPECT_EQ(rows[4]["norm.beta"], 0.2);
  EXPECT_EQ(call({"sweep", "{}/study.toml", "--out", "{}/out"}).code, 2) << "nothing to sweep";
}

const std::string kClaim =
    "[[claim]]\ntext = \"nothing flips\"\npublished = \"0\"\nmetric = \"flipped\"\nis = \"== 0\"\n";
const std::string kFalseClaim = "[[claim]]\ntext = \"more vertices\"\nmetric = \"vertices\"\nis = \"> 25\"\n";
const std::string kVoidClaim =
    "[[claim]]\ntext = \"void\"\nmetric = \"vertices\"\nwhere = \"vertices < 0\"\nis = \"> 25\"\n";

/// Rows without the columns that no two runs share.
nlohmann::json untimed(nlohmann::json rows) {
  for (nlohmann::json& row : rows) {
    std::vector<std::string> times;
    for (const auto& [key, value] : row.items()) {
      if (key.rfind("seconds_", 0) == 0) times.push_back(key);
    }
    EXPECT_FALSE(times.empty());
    for (const std::string& key : times) row.erase(key);
  }
  return rows;
}

TEST_F(Cli, SweepsOfOtherKindsComeFromTheCommandLine) {
  write("study.toml", kStudy);
  const auto sweep = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"sweep", "{}/study.toml", "--out", "{}/out", "--no-figures", "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return call(arguments);
  };
  ASSERT_EQ(sweep({"--zip", "norm.beta=[0, 0.2]", "--zip", "energy.type=[\"asap\", \"larap\"]"}).code, 0);
  nlohmann::json rows = record()["rows"];
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[1]["norm.beta"], 0.2);
  EXPECT_EQ(rows[1]["energy.type"], "larap");

  for (const std::string option : {"--random", "--lhs"}) {
    const Result result = sweep({option, "norm.beta={ min = 0.01, max = 0.5, scale = \"log\" }", option,
                                 "energy.type=[\"asap\", \"larap\"]", option, "domain.h=[0.1, 0.25]", "--samples", "4",
                                 "--seed", "5", "--set", "sweep.seed_key=domain.seed"});
    EXPECT_EQ(result.code, 0) << result.err;
    rows = record()["rows"];
    ASSERT_EQ(rows.size(), 4u);
    std::map<std::string, int> types;
    for (const nlohmann::json& row : rows) {
      EXPECT_TRUE(row["norm.beta"] >= 0.01 && row["norm.beta"] <= 0.5);
      EXPECT_TRUE(row["domain.h"] >= 0.1 && row["domain.h"] <= 0.25);
      EXPECT_TRUE(row["seed"].is_number_integer());
      ++types[row["energy.type"]];
    }
    if (option == "--lhs") {
      EXPECT_EQ(types["asap"], 2);
    }
  }
  // A seed given by hand is no longer one of the sweep.
  EXPECT_EQ(
      sweep({"--grid", "norm.beta=[0, 0.2]", "--set", "sweep.seed_key=domain.seed", "--set", "domain.seed=7"}).code, 0);
  rows = record()["rows"];
  EXPECT_FALSE(rows[0].contains("seed"));
  // The config of the record runs to the same table.
  write("again.toml", record()["config"]);
  ASSERT_EQ(call({"run", "{}/again.toml", "--out", "{}/again", "--no-figures", "--quiet"}).code, 0);
  EXPECT_EQ(untimed(record("again")["rows"]), untimed(rows));

  EXPECT_THAT(sweep({"--zip", "norm.beta=[0]", "--grid", "norm.beta=[1]"}).err,
              HasSubstr("--grid and --zip cannot be mixed"));
  EXPECT_THAT(sweep({"--random", "norm.beta"}).err, HasSubstr("--random norm.beta: expected key=[low, high]"));
  EXPECT_THAT(sweep({"--random", "norm.beta=[0, 0.5]"}).err, HasSubstr("'samples' is missing"));
  write("study.toml", kStudy + "[sweep]\n\"norm.beta\" = [0, 0.2]\n");
  EXPECT_THAT(sweep({"--zip", "norm.beta=[0]"}).err, HasSubstr("--zip: the config sweeps by kind = \"grid\""));
}

/// compare {}/study.toml --out {}/out, each variant once, without pictures.
std::vector<std::string> comparison(const std::vector<std::string>& more) {
  std::vector<std::string> arguments = {"compare", "{}/study.toml", "--out", "{}/out",    "--no-figures",
                                        "--quiet", "--repeats",     "1",     "--warm-up", "0"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

TEST_F(Cli, CompareSolvesTheProblemOfAConfigByLinearBackends) {
  // What the config states of its own experiment is not about backends.
  write("study.toml", kStudy + "[output]\ncolumns = [\"energy\"]\n" + kFalseClaim);
  const Result result = call({"compare", "{}/study.toml", "--out", "{}/out", "--no-figures", "--linear",
                              "eigen.ldlt,eigen.cg", "--repeats", "3", "--reference", "eigen.ldlt"});
  EXPECT_EQ(result.code, 0) << result.err;
  const nlohmann::json rows = record()["rows"];
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[0]["backend"], "eigen.ldlt");
  EXPECT_EQ(rows[1]["backend"], "eigen.cg");
  EXPECT_EQ(rows[0]["difference"], 0.0);
  for (const nlohmann::json& row : rows) {
    EXPECT_EQ(row["solver"], row["backend"]);
    EXPECT_EQ(row["solved"], true);
    EXPECT_LT(row["excess"], 1e-9);
    EXPECT_LT(row["difference"], 1e-6);
    EXPECT_EQ(row["objective"], row["energy_W"]);
    EXPECT_LE(row["seconds_min"], row["seconds_total"]);
    EXPECT_LE(row["seconds_total"], row["seconds_max"]);
    EXPECT_GT(row["peak_memory"], 1.0);
  }
  EXPECT_THAT(record()["claims"], testing::IsEmpty());
  EXPECT_THAT(result.out, AllOf(HasSubstr("| solved |"), HasSubstr("| eigen.cg ")));
  EXPECT_THAT(content_of(at("out/report.html")), HasSubstr("Largest difference of solutions"));
}

TEST_F(Cli, ComparePairsNonlinearWithLinearBackends) {
  write("study.toml", kStudy);
  const Result result = call(comparison({"--nonlinear", "gauss_newton,newton", "--linear", "eigen.ldlt,eigen.llt",
                                         "--set", "energy.type=arap", "--accuracy", "1e-4"}));
  EXPECT_EQ(result.code, 0) << result.err;
  const nlohmann::json rows = record()["rows"];
  ASSERT_EQ(rows.size(), 4U);
  EXPECT_EQ(rows[1]["backend"], "gauss_newton, eigen.llt");
  EXPECT_EQ(rows[2]["backend"], "newton, eigen.ldlt");
  for (const nlohmann::json& row : rows) {
    EXPECT_EQ(row["backend"],
              fmt::format("{}, {}", row["nonlinear"].get<std::string>(), row["solver"].get<std::string>()));
    EXPECT_EQ(row["solved"], true);
    EXPECT_TRUE(row["rate"].is_number() && row["seconds_per_iteration"].is_number());
  }
}

TEST_F(Cli, CompareAllTakesTheBackendsOfThisBuild) {
  write("study.toml", kStudy);
  EXPECT_EQ(call(comparison({"--linear", "all"})).code, 0);
  const nlohmann::json rows = record()["rows"];
  std::size_t count = 0;
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    if (!entry.available) continue;
    ASSERT_LT(count, rows.size());
    EXPECT_EQ(rows[count]["backend"], entry.name);
    if (entry.capabilities.spd) {
      EXPECT_EQ(rows[count]["solved"], true) << entry.name;
    }
    ++count;
  }
  EXPECT_EQ(rows.size(), count);

  EXPECT_EQ(call(comparison({"--nonlinear", "all", "--set", "energy.type=arap"})).code, 0);
  std::map<std::string, nlohmann::json> row_of;
  const nlohmann::json nonlinear = record()["rows"];
  for (const nlohmann::json& row : nonlinear) row_of[row["backend"]] = row;
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    EXPECT_EQ(row_of.count(entry.name), entry.available ? 1U : 0U) << entry.name;
  }
  // The history of `coupled` is that of another functional, which is lower: it must not count as a solution.
  for (const std::string name : {"newton", "gauss_newton"}) {
    EXPECT_EQ(row_of[name]["solved"], true) << name;
  }
  EXPECT_EQ(row_of["coupled"]["objective"], row_of["coupled"]["energy_W"]);
}

TEST_F(Cli, CompareNeedsBackendsThatThereAre) {
  write("study.toml", kStudy);
  const auto message = [&](const std::vector<std::string>& arguments) {
    const Result result = call(comparison(arguments));
    EXPECT_EQ(result.code, 2);
    EXPECT_FALSE(fs::exists(at("out/record.json")));
    return result.err;
  };
  EXPECT_THAT(message({}), ContainsRegex("study.toml: nothing to compare: the config has no .backends.; give "
                                         "--linear or --nonlinear"));
  EXPECT_THAT(message({"--linear", "eigen.ldlt,eigen.nope"}),
              ContainsRegex("study.toml: key 'solver.linear': .*eigen.nope.*expected one of .*eigen.ldlt"));
  EXPECT_THAT(message({"--nonlinear", "nope", "--set", "energy.type=arap"}),
              ContainsRegex("study.toml: key 'solver.nonlinear': .*nope.*expected one of .*newton"));
  EXPECT_THAT(message({"--linear", "eigen.ldlt,eigen.ldlt"}), HasSubstr("'eigen.ldlt' is there already"));
  EXPECT_THAT(message({"--linear", "eigen.ldlt", "--reference", "eigen.llt"}), HasSubstr("key 'backends.reference'"));
  EXPECT_THAT(message({"--linear", "eigen.ldlt", "--accuracy", "0"}), HasSubstr("key 'backends.accuracy'"));
  EXPECT_THAT(message({"--linear", "eigen.ldlt", "--set", "sweep.\"solver.linear\"=[\"eigen.llt\"]"}),
              HasSubstr("'solver.linear' is what the variants of [backends] differ in"));
}

TEST_F(Cli, CompareKeepsTheBackendsOfAConfigAndItsOptions) {
  const std::string backends =
      "[solver]\nlinear = \"eigen.cg\"\nlinear_options = { max_iterations = 1 }\n"
      "[backends]\nrepeats = 3\n[[backends.variant]]\nlinear = \"eigen.cg\"\n"
      "[[backends.variant]]\nname = \"longer\"\nlinear_options = { max_iterations = 1000 }\n"
      "[[backends.variant]]\nlinear = \"eigen.llt\"\n[output]\ncolumns = [\"energy\", \"solved\"]\n";
  write("study.toml", kStudy + backends + kClaim);
  const Result result = call({"compare", "{}/study.toml", "--out", "{}/out", "--no-figures"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("warning: eigen.cg: failed: linear backend 'eigen.cg': no convergence"));
  const nlohmann::json rows = record()["rows"];
  ASSERT_EQ(rows.size(), 3U);
  EXPECT_EQ(rows[0]["status"], "failed");
  EXPECT_EQ(rows[0]["solved"], false);
  EXPECT_EQ(rows[1]["backend"], "longer");
  EXPECT_EQ(rows[1]["solved"], true);
  EXPECT_EQ(rows[2]["solved"], true);
  EXPECT_THAT(result.out, AllOf(HasSubstr("| solved |"), Not(HasSubstr("memory"))));
  // The same by `run`, and with other backends from the command line.
  EXPECT_EQ(run_study({"--quiet"}).code, 0);
  EXPECT_EQ(record()["rows"].size(), 3U);
  EXPECT_EQ(call(comparison({"--linear", "eigen.ldlt,eigen.lu"})).code, 0);
  EXPECT_EQ(record()["rows"].size(), 2U);
}

TEST_F(Cli, ABackendBeyondItsTimeLimitIsARowOfTheComparison) {
  write("study.toml", kStudy);
  // The alternation has no gradient criterion: it goes on for ever.
  const Result result =
      call(comparison({"--nonlinear", "local_global,newton", "--time-limit", "2", "--set", "energy.type=arap", "--set",
                       "solver.tolerance=1e-300", "--set", "solver.max_iterations=1000000000"}));
  EXPECT_EQ(result.code, 0) << result.err;
  const nlohmann::json rows = record()["rows"];
  EXPECT_EQ(rows[0]["status"], "timed_out");
  EXPECT_EQ(rows[0]["reason"], "more than 2 s");
  EXPECT_EQ(rows[0]["solved"], false);
  EXPECT_EQ(rows[1]["solved"], true);
}

TEST_F(Cli, AMissingMeshIsNoResultOfAComparison) {
  write("study.toml", kStudy);
  const Result result = call(comparison({"--linear", "eigen.ldlt", "--set", "domain={ mesh = \"absent.obj\" }"}));
  EXPECT_EQ(result.code, 3);
  EXPECT_THAT(result.err, HasSubstr("absent.obj"));
}

TEST_F(Cli, CompareResumes) {
  write("study.toml", kStudy);
  ASSERT_EQ(call(comparison({"--linear", "eigen.ldlt,eigen.cg"})).code, 0);
  const nlohmann::json rows = record()["rows"];
  fs::remove(at("out/points/point-0001.json"));
  ASSERT_EQ(call(comparison({"--linear", "eigen.ldlt,eigen.cg,eigen.llt", "--resume"})).code, 0);
  const nlohmann::json resumed = record()["rows"];
  ASSERT_EQ(resumed.size(), 3U);
  EXPECT_EQ(resumed[0]["seconds_total"], rows[0]["seconds_total"]) << "taken, not run";
  EXPECT_EQ(untimed(resumed)[0]["energy"], untimed(rows)[0]["energy"]);
  EXPECT_EQ(resumed[1]["backend"], "eigen.cg");
  EXPECT_EQ(resumed[2]["status"], "ok");
}

TEST_F(Cli, TheTableDoesNotDependOnTheNumberOfJobs) {
  write("study.toml",
        kStudy + "[sweep]\n\"norm.beta\" = [0, 0.1, 0.2, 0.3, 0.4]\n\"energy.type\" = [\"asap\", \"arap\"]\n");
  std::map<std::string, nlohmann::json> rows;
  for (const std::string jobs : {"0", "1", "2"}) {
    ASSERT_EQ(run_study({"--jobs", jobs, "--quiet"}).code, 0);
    rows[jobs] = untimed(record()["rows"]);
    EXPECT_EQ(rows[jobs], rows["0"]) << jobs << " jobs";
  }
  EXPECT_EQ(rows["2"].size(), 10u);
}

TEST_F(Cli, PointsWithoutResultAreRowsAndTheExitCodeSaysSo) {
  write("study.toml", kStudy + "[sweep]\n\"solver.linear_options.max_iterations\" = [1, 1000]\n");
  const Result result = run_study({"--set", "solver.linear=eigen.cg"});
  EXPECT_EQ(result.code, 4);
  EXPECT_THAT(result.err, HasSubstr("warning: max_iterations = 1: failed: linear backend 'eigen.cg': no convergence"));
  const nlohmann::json rows = record()["rows"];
  EXPECT_EQ(rows[0]["status"], "failed");
  EXPECT_FALSE(rows[0].contains("energy"));
  EXPECT_EQ(rows[1]["status"], "ok");
  EXPECT_TRUE(rows[1].contains("energy"));
  EXPECT_THAT(result.out, HasSubstr("| failed | linear backend 'eigen.cg'"));
  EXPECT_THAT(content_of(at("out/table.csv")), HasSubstr("1,failed,\"linear backend 'eigen.cg': no convergence"));
}

TEST_F(Cli, AMeshThatIsNotThereCostsItsPointOnly) {
  write("mesh.obj", kMesh);
  write("study.toml", R"(pipeline = "deform"
domain = {}
energy = { type = "arap" }
sweep = { "domain.mesh" = ["absent.obj", "mesh.obj"] }
[[constraint]]
kind = "hard"
vertices = [1, 3]
)");
  for (const std::string jobs : {"0", "1"}) {
    const Result result = run_study({"--jobs", jobs});
    EXPECT_EQ(result.code, 3);
    EXPECT_THAT(result.err, HasSubstr("warning: absent.obj: failed: "));
    EXPECT_EQ(record()["rows"][1]["status"], "ok");
  }
}

TEST_F(Cli, ReproduceGoesOnAfterPointsWithoutResultAndSaysSo) {
  const std::string broken =
      "[sweep]\n\"solver.linear_options.max_iterations\" = [1, 1000]\n[solver]\nlinear = \"eigen.cg\"\n";
  write("set/broken.toml", kStudy + kClaim + broken);
  write("set/whole.toml", kStudy + kClaim);
  const Result result = call({"reproduce", "{}/set", "--out", "{}/out", "--no-figures", "--jobs", "2"});
  EXPECT_EQ(result.code, 4);
  EXPECT_THAT(result.err, HasSubstr("warning: max_iterations = 1: failed: "));
  EXPECT_THAT(result.out, HasSubstr("2 claims, 1 of them not held; 1 experiments with errors"));
  const std::string claims = content_of(at("out/claims.csv"));
  EXPECT_THAT(claims, HasSubstr(",undecided"));
  EXPECT_THAT(claims, HasSubstr(",holds"));
}

TEST_F(Cli, LimitsHoldForEveryPoint) {
  write("study.toml", kStudy + "[sweep]\n\"solver.max_iterations\" = [1, 1000000000]\n");
  const Result result = run_study({"--time-limit", "2", "--set", "energy.type=arap", "--set", "domain.h=0.05", "--set",
                                   "constraint[1].vertices=[400]", "--set", "solver.tolerance=1e-300"});
  EXPECT_EQ(result.code, 4);
  EXPECT_EQ(record()["rows"][0]["status"], "ok") << result.err;
  EXPECT_EQ(record()["rows"][1]["status"], "timed_out");
  EXPECT_EQ(record()["rows"][1]["reason"], "more than 2 s");
  write("study.toml", kStudy);
  const Result single = run_study({"--memory-limit", "1"});
  EXPECT_EQ(single.code, 4);
  EXPECT_THAT(single.err, HasSubstr("error: out_of_memory: more than 1 MiB"));
  EXPECT_THAT(run_study({"--memory-limit", "1", "--jobs", "0"}).err, HasSubstr("need processes"));
  EXPECT_EQ(run_study({"--memory-limit", "-1"}).code, 2);
}

TEST_F(Cli, TablePivotsAFinishedRun) {
  write("study.toml", kStudy + "[sweep]\n\"norm.beta\" = [0, 0.2]\n\"energy.type\" = [\"asap\", \"larap\"]\n");
  ASSERT_EQ(run_study({"--quiet"}).code, 0);
  const auto table = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"table", "{}/out"});
    return call(more);
  };
  const nlohmann::json rows = record()["rows"];
  const Result csv = table({"--rows", "norm.beta", "--columns", "energy.type", "--value", "energy", "--format", "csv"});
  EXPECT_EQ(csv.code, 0) << csv.err;
  EXPECT_EQ(csv.out, fmt::format("norm.beta,energy.type = asap,energy.type = larap\r\n0,{},{}\r\n0.2,{},{}\r\n",
                                 rows[0]["energy"].get<double>(), rows[1]["energy"].get<double>(),
                                 rows[2]["energy"].get<double>(), rows[3]["energy"].get<double>()));
  EXPECT_THAT(table({"--rows", "norm.beta,energy.type", "--value", "flipped"}).out,
              StartsWith("flipped\n\n| norm.beta |"));
  EXPECT_THAT(table({"--rows", "norm.beta", "--value", "energy", "--aggregate", "max", "--format", "tex"}).out,
              HasSubstr("\\caption{max of energy}"));
  EXPECT_EQ(nlohmann::json::parse(table({"--format", "json"}).out), rows) << "without keys: all rows";
  EXPECT_THAT(table({"--rows", "norm.beta", "--value", "energy"}).err, HasSubstr("2 rows for norm.beta = 0"));
  const Result unknown = table({"--rows", "norm.bet", "--value", "energy"});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("no row has 'norm.bet' (did you mean 'norm.beta'?); accepted: keys of the rows"));
  EXPECT_EQ(table({"--rows", "norm.beta"}).code, 2) << "no value";
  EXPECT_EQ(call({"table", "{}/nowhere", "--rows", "a", "--value", "b"}).code, 3);
}

TEST_F(Cli, ListNamesTheKeysOfTheCommonSections) {
  const Result result = call({"list", "config"});
  EXPECT_EQ(result.code, 0);
  for (const char* text : {"[[constraint]]", "[sweep]", "[output]", "[[claim]]", "[[plot]]", "[bisect]", "[compare]",
                           "relative_to", "max_panels", "seed_key", "quantifier", "log_x", "reference"}) {
    EXPECT_THAT(result.out, HasSubstr(text));
  }
  EXPECT_THAT(call({"list"}).out, HasSubstr("[[claim]]"));
}

TEST_F(Cli, TwoRunsDoNotShareAFolder) {
  write("study.toml", kStudy + "[sweep]\n\"norm.beta\" = [0, 0.2]\n");
  const Process first = start({"run", "{}/study.toml", "--out", "{}/out", "--no-figures", "--set", "domain.h=0.002",
                               "--set", "constraint[0].vertices=[0, 1]", "--set", "constraint[1].vertices=[2, 3]"});
  for (int i = 0; i < 6000 && !fs::exists(at("out/points")); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const Result second = run_study();
  EXPECT_EQ(second.code, 2);
  EXPECT_THAT(second.err, ContainsRegex("out: another run \\(process [0-9]+\\) is writing to this folder"));
  first.signal(SIGINT);
  EXPECT_EQ(first.wait(), 128 + SIGINT) << "in the middle of a point";
  EXPECT_EQ(run_study().code, 0);
}

/// The file of every point that is finished, with its content.
std::map<std::string, std::string> checkpoints_in(const fs::path& folder) {
  std::map<std::string, std::string> checkpoints;
  if (!fs::exists(folder)) return checkpoints;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".json") checkpoints[entry.path().filename()] = content_of(entry.path());
  }
  return checkpoints;
}

TEST_F(Cli, ASweepKilledTenTimesAndResumedEndsInTheTableOfAnUndisturbedOne) {
  constexpr int kPoints = 200;
  constexpr int kKills = 10;
  std::string betas = "0";
  for (int i = 1; i < kPoints; ++i) betas += fmt::format(", {}", i / 300.0);
  write("study.toml", kStudy + kClaim + "[sweep]\n\"norm.beta\" = [" + betas + "]\n");
  ASSERT_EQ(call({"run", "{}/study.toml", "--out", "{}/whole", "--no-figures", "--quiet", "--jobs", "2"}).code, 0);

  const std::vector<std::string> resume = {"run",     "{}/study.toml", "--out", "{}/out",  "--no-figures",
                                           "--quiet", "--jobs",        "2",     "--resume"};
  std::mt19937 random(1);
  std::map<std::string, std::string> finished;
  for (int i = 0; i < kKills; ++i) {
    const Process process = start(resume);
    // Somewhere in the next part of the points, and at any moment of a point.
    const std::size_t target = finished.size() + 1 + random() % (kPoints / kKills - 4);
    for (int k = 0; k < 20000 && checkpoints_in(at("out/points")).size() < target; ++k) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 20000));
    process.signal(SIGKILL);
    ASSERT_EQ(process.wait(), -SIGKILL) << "it ended before it could be killed";
    const std::map<std::string, std::string> now = checkpoints_in(at("out/points"));
    EXPECT_GE(now.size(), target);
    for (const auto& [name, content] : finished) {
      EXPECT_EQ(now.at(name), content) << "a finished point was run again";
    }
    finished = now;
    EXPECT_FALSE(fs::exists(at("out/record.json")));
  }
  EXPECT_LT(finished.size(), static_cast<std::size_t>(kPoints));
  const Result result = call(resume);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(record()["rows"].size(), static_cast<std::size_t>(kPoints));
  EXPECT_EQ(untimed(record()["rows"]), untimed(record("whole")["rows"]));
  EXPECT_EQ(record()["claims"], record("whole")["claims"]);
  for (const auto& [name, content] : finished) EXPECT_EQ(content_of(at("out/points/" + name)), content) << name;
  for (const auto& entry : fs::recursive_directory_iterator(at("out"))) {
    EXPECT_NE(entry.path().extension(), ".tmp") << entry.path() << " was left by a writer that was killed";
  }
}

TEST_F(Cli, ReproduceAnswersByItsClaims) {
  write("good/study.toml", kStudy + kClaim);
  const std::vector<std::string> options = {"--out", "{}/out", "--no-figures"};
  const auto reproduce = [&](std::vector<std::string> places) {
    places.insert(places.begin(), "reproduce");
    places.insert(places.end(), options.begin(), options.end());
    return call(places);
  };
  const Result good = reproduce({"{}/good"});
  EXPECT_EQ(good.code, 0) << good.err;
  EXPECT_TRUE(std::regex_search(good.out, std::regex(R"(good/study \| nothing flips \| 0 .*\| holds)"))) << good.out;
  EXPECT_THAT(good.out, HasSubstr("1 claims, 0 of them not held; 0 experiments with errors"));
  EXPECT_TRUE(fs::exists(at("out/good/study/record.json")));
  EXPECT_THAT(content_of(at("out/claims.csv")), HasSubstr("good/study,nothing flips,0,0 (1 row),holds"));

  write("bad/study.toml", kStudy + kFalseClaim);
  const Result bad = reproduce({"{}/good", "{}/bad"});
  EXPECT_EQ(bad.code, 1);
  EXPECT_THAT(bad.out, HasSubstr("2 claims, 1 of them not held"));
  write("void/study.toml", kStudy + kVoidClaim);
  EXPECT_EQ(reproduce({"{}/void/study.toml"}).code, 1) << "undecided is not held";

  write("broken/study.toml", kStudy + "[typo]\n");
  const Result broken = reproduce({"{}/good", "{}/bad", "{}/broken"});
  EXPECT_EQ(broken.code, 2);
  EXPECT_THAT(broken.err, HasSubstr("key 'typo'"));
  EXPECT_THAT(broken.out, HasSubstr("1 experiments with errors"));

  write("elsewhere/study.toml", "requires = [\"no-such-mesh.obj\"]\n" + kStudy + kFalseClaim);
  fs::remove_all(at("out"));
  const Result skipped = reproduce({"{}/elsewhere"});
  EXPECT_EQ(skipped.code, 0) << skipped.err;
  EXPECT_THAT(skipped.out, HasSubstr("skipped"));
  EXPECT_EQ(reproduce({"{}/nowhere"}).code, 2);
}

TEST_F(Cli, AFailedClaimIsNoFailureOfARun) {
  write("study.toml", kStudy + kFalseClaim);
  EXPECT_EQ(run_study().code, 0);
  EXPECT_EQ(record()["claims"][0]["outcome"], "fails");
}

TEST_F(Cli, ResumeGivesTheSameTable) {
  write("study.toml", kStudy + "[sweep]\n\"norm.beta\" = [0, 0.2, 0.4]\n");
  ASSERT_EQ(run_study().code, 0);
  const std::string table = content_of(at("out/table.csv"));
  fs::remove(at("out/record.json"));
  ASSERT_EQ(run_study({"--resume"}).code, 0);
  EXPECT_EQ(content_of(at("out/table.csv")), table) << "with the seconds of the first run";
  ASSERT_EQ(run_study().code, 0);
  EXPECT_NE(content_of(at("out/table.csv")), table) << "without --resume, times differ";
}

TEST_F(Cli, ResumeSeesThatTheMeshChanged) {
  write("mesh.obj", kMesh);
  write("study.toml", R"(pipeline = "deform"
domain = { mesh = "mesh.obj" }
energy = { type = "arap" }
solver = { tolerance = 1e-12 }
[[constraint]]
kind = "hard"
vertices = [1, 3]
)");
  ASSERT_EQ(run_study().code, 0);
  std::string moved = kMesh;
  moved.replace(moved.find("v 1 1 0"), 7, "v 1 1.2 0");
  write("mesh.obj", moved);
  ASSERT_EQ(run_study({"--resume"}).code, 0);
  EXPECT_NEAR(read_obj(content_of(at("out/meshes/point-0000.obj"))).vertices[2][1], 1.2, 1e-9);
}

TEST_F(Cli, AnInterruptLeavesAValidRecordOfWhatIsFinished) {
  write("study.toml", kStudy + kClaim);
  std::string betas = "0";
  constexpr int kPoints = 80;
  for (int i = 1; i < kPoints; ++i) betas += fmt::format(", {}", i / 100.0);
  const std::vector<std::string> sweep = {"sweep",
                                          "{}/study.toml",
                                          "--out",
                                          "{}/out",
                                          "--no-figures",
                                          "--grid",
                                          fmt::format("norm.beta=[{}]", betas),
                                          "--set",
                                          "domain.h=0.02",
                                          "--set",
                                          "constraint[0].vertices=[0, 1]",
                                          "--set",
                                          "energy.type=arap",
                                          "--set",
                                          "constraint[1].vertices=[2600]"};
  const Process process = start(sweep);
  for (int i = 0; i < 6000 && !fs::exists(at("out/points/point-0001.json")); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ASSERT_TRUE(fs::exists(at("out/points/point-0001.json"))) << process.err();
  EXPECT_FALSE(fs::exists(at("out/record.json"))) << "there is no record before the end";
  process.signal(SIGINT);
  EXPECT_EQ(process.wait(), 128 + SIGINT);
  const nlohmann::json partial = record();
  const std::size_t rows = partial["rows"].size();
  EXPECT_GE(rows, 2u);
  EXPECT_LT(rows, static_cast<std::size_t>(kPoints));
  EXPECT_THAT(partial["warnings"].dump(), HasSubstr(fmt::format("interrupted after {} of {} points", rows, kPoints)));
  EXPECT_EQ(partial["claims"][0]["outcome"], "undecided");
  for (const nlohmann::json& row : partial["rows"]) {
    EXPECT_TRUE(fs::exists(at("out") / row["mesh"].get<std::string>()));
  }
  EXPECT_THAT(process.err(), HasSubstr("warning: interrupted"));
}

struct BadInput {
  const char* name;
  int code;
  const char* pattern;                            ///< of stderr
  std::vector<std::string> arguments = {};        ///< behind run STUDY --out OUT, or all if the first is no option
  std::string study = kStudy;                     ///< study.toml
  std::map<std::string, std::string> files = {};  ///< beside it
};

std::ostream& operator<<(std::ostream& stream, const BadInput& input) { return stream << input.name; }

class BadInputs : public Cli, public ::testing::WithParamInterface<BadInput> {};

TEST_P(BadInputs, EndWithTheRightCodeAndAMessageThatNamesTheFault) {
  const BadInput& input = GetParam();
  write("study.toml", input.study);
  for (const auto& [name, content] : input.files) write(name, content);
  std::vector<std::string> arguments = input.arguments;
  if (arguments.empty() || arguments.front().front() == '-') {
    const std::vector<std::string> run = {"run", "{}/study.toml", "--out", "{}/out", "--quiet"};
    arguments.insert(arguments.begin(), run.begin(), run.end());
  }
  const Result result = call(arguments);
  EXPECT_EQ(result.code, input.code) << result.err;
  EXPECT_TRUE(std::regex_search(result.err, std::regex(input.pattern))) << result.err;
  EXPECT_FALSE(fs::exists(at("out/record.json")));
}

std::string replaced(const std::string& what, const std::string& by) {
  std::string study = kStudy;
  const std::size_t place = study.find(what);
  if (place == std::string::npos) throw std::logic_error("nothing to replace: " + what);
  return study.replace(place, what.size(), by);
}

/// The study on a mesh file of the same folder, and that file.
BadInput on_mesh(const char* name, int code, const char* pattern, const std::string& file, const std::string& content) {
  return {
      name,
      code,
      pattern,
      {"--set", "domain={ mesh = \"" + file + "\" }", "--set", "constraint=[{ kind = \"hard\", vertices = [0, 1] }]"},
      kStudy,
      {{file, content}}};
}

BadInput with(const char* name, int code, const char* pattern, const std::string& assignment) {
  return {name, code, pattern, {"--set", assignment}};
}

BadInput with_study(const char* name, int code, const char* pattern, const std::string& study,
                    const std::string& assignment) {
  return {name, code, pattern, {"--set", assignment}, study};
}

const std::string kField = R"(pipeline = "vector_field"
[domain]
generator = "square"
h = 0.25
[energy]
type = "akvf"
[[constraint]]
kind = "hard"
vertices = [0, 5]
[[constraint]]
kind = "hard"
vertices = [24]
velocity = [0.1, 0.0]
)";

const std::string kMap = R"(pipeline = "parametrize"
[domain]
generator = "bump"
h = 0.25
[energy]
type = "lscm"
)";

const char* const kTetrahedra =
    "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\nTetrahedra\n1\n1 2 3 4 0\n"
    "End\n";
const std::string kTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

const std::vector<BadInput> kBadInputs = {
    // Keys and values of configs.
    {"UnknownTopLevelKey",
     2,
     "study.toml:1: key 'titel': unknown key; accepted here: title",
     {},
     "titel = 1\n" + kStudy},
    {"UnknownSection",
     2,
     R"(study.toml:\d+: key 'regularizer': unknown key)",
     {},
     kStudy + "[regularizer]\nbeta = 1\n"},
    {"UnknownKeyOfNorm", 2, "study.toml:8: key 'norm.betta': unknown key.*beta", {}, replaced("beta", "betta")},
    {"UnknownKeyOfGenerator", 2, "study.toml:4: key 'domain.hh': unknown key", {}, replaced("h =", "hh =")},
    {"UnknownKeyOfConstraint", 2, "key 'constraint.0..verts': unknown key", {}, replaced("vertices", "verts")},
    with("UnknownKeyOfEnergy", 2, "key 'energy.order': unknown key", "energy.order=3"),
    with("UnknownKeyOfSolver", 2, "key 'solver.max_iteration': unknown key", "solver.max_iteration=3"),
    with("UnknownLinearOption", 2, "key 'solver.linear_options.tol': unknown key", "solver.linear_options.tol=3"),
    with("UnknownKeyOfOutput", 2, "key 'output.column': unknown key", "output.column=[\"energy\"]"),
    with("WrongType", 2, R"(key 'norm.beta': expected a number in \[0, 1\) or "auto")", "norm.beta=abc"),
    with("TableExpected", 2, "key 'domain': expected a table, got 3", "domain=3"),
    with("ArrayExpected", 2, "key 'constraint': expected an array", "constraint={ kind = \"hard\" }"),
    with("BetaOne", 2, R"(key 'norm.beta': 'beta' = 1: expected a value in \[0, 1\))", "norm.beta=1"),
    with("BetaNegative", 2, R"('beta' = -0.1: expected a value in \[0, 1\))", "norm.beta=-0.1"),
    with("BetaNotANumber", 2, "'beta' = nan: expected a value", "norm.beta=nan"),
    with("EdgeLengthZero", 2, "'h' = 0: expected a positive number", "domain.h=0"),
    with("TooManyCells", 2, "'h' = 1e-09: this makes .* cells; expected at most", "domain.h=1e-9"),
    with("UnknownEnergy", 2, "key 'energy.type': unknown energy 'asapp'; known: .*asap", "energy.type=asapp"),
    with("UnknownBackend", 2, "key 'solver.linear': .*\"cholesky\": expected one of auto", "solver.linear=cholesky"),
    with("UnknownNonlinear", 2, "key 'solver.nonlinear': .*expected one of local_global", "solver.nonlinear=lbfgs"),
    with("UnknownGenerator", 2, "key 'domain.generator': unknown generator 'circle'; known: square",
         "domain.generator=circle"),
    with("UnknownPipeline", 2,
         "key 'pipeline': unknown pipeline 'deform.plane'; known: deform, parametrize, vector_field",
         "pipeline=deform.plane"),
    with("UnknownFacetWeight", 2, "key 'norm.facet_weight': .*expected one of facet_measure", "norm.facet_weight=area"),
    {"NoPipeline", 2, "study.toml:1: 'pipeline' is missing", {}, "title = \"x\"\n"},
    {"NoEnergy", 2, "'energy' is missing", {}, replaced("[energy]\ntype = \"asap\"\n", "")},
    {"NoEnergyType", 2, "study.toml:5: key 'energy': 'type' is missing", {}, replaced("type = \"asap\"\n", "")},
    {"NoDomain", 2, "'domain' is missing", {}, replaced("[domain]\ngenerator = \"square\"\nh = 0.25\n", "")},
    {"EmptyConfig", 2, "'pipeline' is missing", {}, ""},
    {"TomlSyntax", 2, "study.toml:4: .*", {}, replaced("h = 0.25", "h = 0.2.5")},
    {"TomlOpenString", 2, "study.toml:1: .*", {}, "pipeline = \"deform\n"},
    {"TomlKeyTwice", 2, "study.toml:9: .*beta", {}, replaced("beta = 0.2", "beta = 0.2\nbeta = 0.3")},
    {"EmptySweep",
     2,
     "key 'sweep.norm.beta': expected at least one value",
     {},
     kStudy + "[sweep]\n\"norm.beta\" = []\n"},
    {"SweepOfNothing", 2, "'nrom.beta' is in no section", {}, kStudy + "[sweep]\n\"nrom.beta\" = [0]\n"},
    {"SweptValueOutOfRange",
     2,
     R"(study.toml:17: key 'norm.beta': 'beta' = 1: expected)",
     {},
     kStudy + "[sweep]\n\"norm.beta\" = [0, 1]\n"},
    {"BadClaim",
     2,
     "key 'claim.0..is': 'is' = \"about 1\": expected a comparison",
     {},
     kStudy + "[[claim]]\ntext = \"t\"\nmetric = \"energy\"\nis = \"about 1\"\n"},
    {"BadCondition",
     2,
     "key 'claim.0..where': condition 'beta': 'beta' is no comparison",
     {},
     kStudy + "[[claim]]\ntext = \"t\"\nmetric = \"energy\"\nis = \"> 1\"\nwhere = \"beta\"\n"},
    with("MeshAndGenerator", 2, "key 'domain': expected either 'generator' or 'mesh'", "domain.mesh=a.obj"),
    with("BadRepair", 2, "key 'domain.repair.0.': expected orientation", "domain.repair=[\"holes\"]"),
    {"LeastSquaresForEqualities",
     2,
     "not a least-squares one|is not compiled in",
     {"--set", "solver.linear=spqr", "--set",
      "constraint=[{ kind = \"hard\", vertices = [0, 1] }, "
      "{ kind = \"linear\", vertices = [7, 8], weights = [1, -1], value = [0.2, 0] }]"}},
    {"DefiniteBackendForEqualities",
     2,
     "'eigen.llt': does not solve symmetric indefinite",
     {"--set", "solver.linear=eigen.llt", "--set",
      "constraint=[{ kind = \"hard\", vertices = [0, 1] }, "
      "{ kind = \"linear\", vertices = [7, 8], weights = [1, -1], value = [0.2, 0] }]"}},
    // Pipelines for surfaces, velocities and the choice of beta.
    with("BetaMaybe", 2, R"(key 'norm.beta': expected a number in \[0, 1\) or "auto")", "norm.beta=maybe"),
    with("UnknownKeyOfAuto", 2, "key 'norm.auto.untill': unknown key; accepted here: method, until",
         "norm={ beta = \"auto\", auto = { untill = \"flipped == 0\" } }"),
    with("UnknownKeyOfUnusedAuto", 2, "key 'norm.auto.untill': unknown key",
         "norm={ beta = 0.2, auto = { untill = \"flipped == 0\" } }"),
    with("AutoWithoutComparison", 2, "key 'norm.auto.until': condition 'flipped': 'flipped' is no comparison",
         "norm={ beta = \"auto\", auto = { until = \"flipped\" } }"),
    with("AutoOnNoMetric", 2, "key 'norm.auto.until': no row will have 'flips'.*flipped",
         "norm={ beta = \"auto\", auto = { until = \"flips == 0\" } }"),
    with("UnknownMethodOfAuto", 2, "key 'norm.auto.method': .*\"golden\": expected one of smallest, l_curve",
         "norm={ beta = \"auto\", auto = { method = \"golden\" } }"),
    with("LCurveUpsideDown", 2, "key 'norm.auto': expected low < high",
         "norm={ beta = \"auto\", auto = { method = \"l_curve\", low = 0.5, high = 0.1 } }"),
    with("AutoStartsTooHigh", 2, "key 'norm.auto': expected start <= high",
         "norm={ beta = \"auto\", auto = { start = 0.9, high = 0.5 } }"),
    {"AsapOnTetrahedra",
     2,
     "key 'energy.type': energy 'asap' needs a planar or surface domain, this one is tetrahedral: .*'conf'",
     {"--set", "domain={ generator = \"cube_tet\", h = 0.5 }", "--set",
      "constraint=[{ kind = \"hard\", vertices = [0, 1, 2, 3] }]"}},
    with("AsapOfASurface", 2, "key 'energy.type': this energy maps a surface mesh to dimension 2: .*parametrize",
         "domain={ generator = \"bump\", h = 0.25 }"),
    with("VelocitiesInDeform", 2, "energy 'akvf' is one of velocity fields: see pipeline vector_field",
         "energy.type=akvf"),
    with("StartOfAnotherPipeline", 2, "key 'solver.start': .*\"tutte\": expected one of rest, larap, poisson",
         "solver.start=tutte"),
    with_study("DeformationAsVelocities", 2, "key 'energy.type': energy 'arap' is not one of velocity fields", kField,
               "energy.type=arap"),
    with_study("VelocitiesOfASurface", 2, "need a planar or tetrahedral domain, this one is surface", kField,
               "domain={ generator = \"bump\", h = 0.25 }"),
    with_study("MoveAmongVelocities", 2, "key 'constraint.1..move': unknown key; .*velocity", kField,
               "constraint[1].move=[0.1, 0]"),
    with_study("VelocityOfOneCoordinate", 2, "key 'constraint.1..velocity': expected 2 coordinates, got 1", kField,
               "constraint[1].velocity=[0.1]"),
    with_study("AxisInThePlane", 2, "key 'constraint.1..velocity.axis': an axis is for rotations in space", kField,
               "constraint[1].velocity={ rotate = 10, axis = [0, 0, 1] }"),
    with_study("NegativeStep", 2, "key 'flow.step': 'step' = -1", kField, "flow.step=-1"),
    with_study("UnknownKeyOfFlow", 2, "key 'flow.steps': unknown key; accepted here: step", kField, "flow.steps=2"),
    with_study("PhiOutOfRange", 2, R"(phi = 3: expected a value in \(0, 2.67)", kField,
               "energy={ type = \"phi\", phi = 3 }"),
    with_study("OnePin", 3, "needs two pins at different places", kMap,
               "constraint=[{ kind = \"hard\", vertices = [3] }]"),
    with_study("TwoPinsAtOnePlace", 3, "needs two pins at different places", kMap,
               "constraint=[{ kind = \"hard\", vertices = [3, 4], positions = [[1, 1], [1, 1]] }]"),
    with_study("PinInSpace", 2, "positions.0.': expected 2 coordinates, got 3", kMap,
               "constraint=[{ kind = \"hard\", vertices = [3], positions = [[1, 1, 1]] }]"),
    {"TutteOfAClosedSurface",
     3,
     "tutte map: the domain must be a disk, .*0 boundary loop.*cut it open",
     {"--set", "domain={ generator = \"sphere\", h = 0.5 }", "--set", "parametrization.initial=tutte"},
     kMap},
    with_study("PinsOfAClosedSurface", 3, "the domain must be a disk, .*cut it open", kMap,
               "domain={ generator = \"sphere\", h = 0.5 }"),
    with_study("MapOfTetrahedra", 2, "key 'energy.type': .*needs a surface or planar domain, this one is tetrahedral",
               kMap, "domain={ generator = \"cube_tet\", h = 0.5 }"),
    with_study("DeformationAsMap", 2, "maps a surface mesh to dimension 3: no parametrization", kMap,
               "energy.type=arap"),
    with_study("UnknownInitialMap", 2, "key 'parametrization.initial': .*expected one of lscm, tutte, projection", kMap,
               "parametrization.initial=harmonic"),
    with_study("CutPathOfOneVertex", 2, "key 'domain.cut.path': expected at least 2 vertices", kMap,
               "domain={ generator = \"sphere\", h = 0.5, cut = { path = [0] } }"),
    with_study("CutPathLeavesTheMesh", 3, "key 'domain.cut.path': vertex 999 does not exist", kMap,
               "domain={ generator = \"sphere\", h = 0.5, cut = { path = [0, 999] } }"),
    with_study("CutAlongNoEdge", 3, R"(key 'domain.cut': edge \(0, 9\) is not in the mesh)", kMap,
               "domain={ generator = \"sphere\", h = 0.5, cut = { edges = [[0, 9]] } }"),
    with_study("CutTwoWays", 2, "key 'domain.cut': expected one of", kMap,
               "domain={ generator = \"sphere\", h = 0.5, cut = { to_disk = true, path = [0, 1] } }"),
    with_study("CutOfTetrahedra", 2, "key 'domain.cut': only triangle meshes can be cut", kMap,
               "domain={ generator = \"cube_tet\", h = 0.5, cut = { to_disk = true } }"),
    // Command lines.
    with("SetWithoutEquals", 2, "--set norm.beta: expected key=value", "norm.beta"),
    with("SetOfNoPath", 2, "key 'norm..beta': expected names separated by dots", "norm..beta=1"),
    with("SetBeyondAnArray", 2, "'constraint' has no element 7", "constraint[7].kind=soft"),
    {"NoSuchConfig", 2, "absent.toml: cannot be read", {"run", "{}/absent.toml", "--out", "{}/out"}},
    {"ConfigIsAFolder", 2, "is a folder, expected a TOML config", {"run", "{}", "--out", "{}/out"}},
    {"UnknownSubcommand", 2, "deform", {"deform", "{}/study.toml"}},
    {"NoOut", 2, "--out is required", {"run", "{}/study.toml"}},
    {"EmptyOut", 2, "--out: expected a folder", {"run", "{}/study.toml", "--out", ""}},
    {"UnknownOption", 2, "--fast", {"run", "{}/study.toml", "--out", "{}/out", "--fast"}},
    {"ListOfNothing", 2, "what", {"list", "meshes"}},
    {"GridWithoutEquals",
     2,
     "--grid norm.beta: expected key=",
     {"sweep", "{}/study.toml", "--out", "{}/out", "--grid", "norm.beta"}},
    {"GridWithoutArray",
     2,
     "key 'sweep.norm.beta': expected an array",
     {"sweep", "{}/study.toml", "--out", "{}/out", "--grid", "norm.beta=0.3"}},
    {"OutBelowAFile", 3, "study.toml/out: cannot be created", {"run", "{}/study.toml", "--out", "{}/study.toml/out"}},
    {"InfoOfNothing", 3, "absent.obj", {"info", "{}/absent.obj"}},
    {"InfoOfABrokenMesh",
     3,
     "bad.obj:4",
     {"info", "{}/bad.obj"},
     kStudy,
     {{"bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"}}},
    // Mesh files.
    with("MeshMissing", 3, "'absent.obj' is not there; looked at .*absent.obj", "domain={ mesh = \"absent.obj\" }"),
    on_mesh("MeshTruncated", 3, "mesh.off:2: found 3 vertices, expected 0 to 2", "mesh.off", "OFF\n3 1 0\n0 0 0\n1 0"),
    on_mesh("MeshHasNaN", 3, "mesh.obj:2: .*nan", "mesh.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n"),
    on_mesh("MeshIndexOutOfRange", 3, "mesh.obj:4: .*9", "mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
    on_mesh("MeshDegenerate", 3, "mesh.obj: .*(cell|triangle) 1 .*", "mesh.obj",
            kTriangle + "v 1 0 0\nv 2 0 0\nv 3 0 0\nf 4 5 6\n"),
    on_mesh("MeshDuplicate", 3, "mesh.obj: cell 1 .*the same vertices as cell 0", "mesh.obj", kTriangle + "f 2 3 1\n"),
    on_mesh("MeshNonManifold", 3, "mesh.obj: .*(edge|facet).*(three|3|more than two)", "mesh.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 2 2 0\nf 1 2 3\nf 3 2 4\nf 3 2 5\n"),
    on_mesh("MeshOfTetrahedra", 2, "key 'energy.type': .*needs a planar or surface domain, this one is tetrahedral",
            "mesh.mesh", kTetrahedra),
    on_mesh("MeshIsCurved", 2,
            "key 'energy.type': this energy maps a surface mesh to dimension 2: .*see pipeline parametrize", "mesh.obj",
            kTriangle + "v 1 1 1\nf 3 2 4\n"),
    on_mesh("MeshOfQuads", 3, "mesh.obj:5: .*triangul", "mesh.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"),
    on_mesh("MeshEmpty", 3, "mesh.obj", "mesh.obj", ""),
    on_mesh("MeshOfPointsOnly", 3, "mesh.obj", "mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
    on_mesh("MeshOfAnotherKind", 2, "mesh.xyz: unknown extension '.xyz'; known: .obj", "mesh.xyz", "0 0 0\n"),
    {"MeshIsAFolder",
     3,
     "mesh.obj.*(folder|directory|read)",
     {"--set", "domain={ mesh = \"mesh.obj\" }"},
     kStudy,
     {{"mesh.obj/inside.txt", ""}}},
    on_mesh("MeshIsBinaryNoise", 3, "mesh.ply", "mesh.ply", std::string("\0\xff\x7f\x00noise", 9)),
    // Constraints.
    with("VertexOutOfRange", 3, R"(key 'constraint\[0\].vertices\[1\]': vertex 25 does not exist; .*0 to 24)",
         "constraint[0].vertices=[0, 25]"),
    {"VertexOutOfRangeWithLine",
     3,
     R"(study.toml:11: key 'constraint\[0\].vertices\[1\]': vertex 25)",
     {},
     replaced("[0, 5]", "[0, 25]")},
    with("VertexNegative", 3, "vertex -1 does not exist", "constraint[0].vertices=[-1]"),
    with("Contradiction", 3, "key 'constraint.1.': .*vertex 0 is fixed at both", "constraint[1].vertices=[0, 24]"),
    with("FixedApartAndIdentified", 3, R"(vertices 0 and 1 are identified, but fixed at \(0, 0\) and \(0.25, 0\))",
         "constraint=[{ kind = \"hard\", vertices = [0, 1] }, { kind = \"identify\", vertices = [0, 1] }]"),
    with("TooFewForTheKernel", 3, "too few constraints: component 0 of 1 .*1 constrained vertices.*2 of the 4",
         "constraint=[{ kind = \"hard\", vertices = [3] }]"),
    with("NoConstraints", 3, "too few constraints: component 0", "constraint=[]"),
    on_mesh("FreeComponent", 3, "too few constraints: component 1 of 2", "mesh.obj",
            kTriangle + "v 5 0 0\nv 6 0 0\nv 5 1 0\nf 4 5 6\n"),
    with("EmptySelection", 3, "select.box': no vertex is selected",
         "constraint=[{ kind = \"hard\", select = { box = [5, 5, 6, 6] } }]"),
    with("PointFarFromTheMesh", 3, "select.near': the nearest vertex, [0-9]+, is .* away",
         "constraint=[{ kind = \"hard\", select = { near = [50, 6] } }]"),
    with("EmptyVertices", 2, "key 'constraint.0..vertices': expected at least one", "constraint[0].vertices=[]"),
    {"WrongNumberOfPositions",
     2,
     "key 'constraint.1..positions': 2 positions for 1 vertices",
     {"--set", "constraint[1].positions=[[1, 1], [2, 2]]"}},
    with("PositionOfThreeCoordinates", 2, "key 'constraint.1..positions.0.': expected 2 coordinates, got 3",
         "constraint[1].positions=[[1, 1, 1]]"),
    with("PositionNotANumber", 2, "positions.0.': expected finite numbers", "constraint[1].positions=[[1, nan]]"),
    with("PositionsAndMove", 2, "expected either 'positions' or 'move'", "constraint[0].positions=[[0, 0], [1, 1]]"),
    with("VerticesAndSelect", 2, "expected either 'vertices' or 'select'", "constraint[0].select={ boundary = true }"),
    with("UnknownKindOfConstraint", 2, "expected hard, soft, identify or linear", "constraint[0].kind=fixed"),
    with("UnknownSelection", 2, "key 'constraint.0..select.bx': unknown key",
         "constraint=[{ kind = \"hard\", select = { bx = [0, 0, 1, 1] } }]"),
    with("NegativeSoftWeight", 3, "soft weight -1", "constraint=[{ kind = \"soft\", vertices = [0, 1], weight = -1 }]"),
    with("EqualityWithoutWeight", 2, "expected a weight that is not 0",
         "constraint=[{ kind = \"linear\", vertices = [0, 1], weights = [0, 0], value = [0, 0] }]"),
    // Solvers.
    {"NoConvergence",
     4,
     "linear backend 'eigen.cg': no convergence .*after 1 iteration",
     {"--set", "solver.linear=eigen.cg", "--set", "solver.linear_options.max_iterations=1"}},
};

INSTANTIATE_TEST_SUITE_P(Cli, BadInputs, ::testing::ValuesIn(kBadInputs),
                         [](const auto& test) { return std::string(test.param.name); });

TEST_F(Cli, AFailedRunTakesAnOldRecordAway) {
  write("study.toml", kStudy);
  ASSERT_EQ(run_study().code, 0);
  EXPECT_EQ(run_study({"--set", "norm.beta=2"}).code, 2);
  EXPECT_TRUE(fs::exists(at("out/record.json"))) << "a config that is refused changes nothing";
  EXPECT_EQ(run_study({"--set", "constraint=[]"}).code, 3);
  EXPECT_FALSE(fs::exists(at("out/record.json")));
}

}  // namespace
}  // namespace variform
