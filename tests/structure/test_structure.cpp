// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "experiments/pipelines.h"
#include "framework/experiment/runner.h"
#include "integrators/ode/ode_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::StartsWith;

const fs::path kSource = VARIFORM_SOURCE_DIR;

std::string content_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

/// Files below folders of the source tree by extension, relative to it.
std::vector<fs::path> files_in(const std::vector<std::string>& folders, const std::set<std::string>& extensions) {
  std::vector<fs::path> files;
  for (const std::string& folder : folders) {
    for (const auto& entry : fs::recursive_directory_iterator(kSource / folder)) {
      if (extensions.count(entry.path().extension().string()) > 0) files.push_back(fs::relative(entry.path(), kSource));
    }
  }
  return files;
}

/// The layer of a file: its first folder, or the first two inside framework.
std::string layer_of(const fs::path& file) {
  auto part = file.begin();
  const std::string first = part->string();
  if (first != "framework") return first;
  return first + "/" + std::next(part)->string();
}

std::vector<std::string> matches(const std::string& text, const std::string& pattern) {
  const std::regex regex(pattern, std::regex::multiline);
  std::vector<std::string> found;
  for (std::sregex_iterator match(text.begin(), text.end(), regex), end; match != end; ++match) {
    found.push_back((*match)[1]);
  }
  return found;
}

/// Names in a list macro such as VARIFORM_PIPELINES(X): X(a) X(b).
std::set<std::string> listed(const fs::path& file) {
  const std::vector<std::string> names = matches(content_of(kSource / file), R"(\bX\((\w+)\))");
  return {names.begin(), names.end()};
}

std::set<std::string> defined(const std::string& folder, const std::string& type) {
  std::set<std::string> names;
  for (const fs::path& file : files_in({folder}, {".cpp"})) {
    for (const std::string& name : matches(content_of(kSource / file), "^" + type + R"( describe_(\w+)\(\) *\{)")) {
      names.insert(name);
    }
  }
  return names;
}

TEST(Structure, IncludesFollowTheLayers) {
  const std::set<std::string> base = {"framework/base"};
  const std::set<std::string> domain = {"framework/base", "framework/domain"};
  std::set<std::string> topology = domain;
  topology.insert("framework/topology");
  std::set<std::string> operators = topology;
  operators.insert("framework/operators");
  const std::set<std::string> solver = {"framework/base", "framework/solver"};
  std::set<std::string> form = operators;
  form.insert({"framework/solver", "framework/form"});
  std::set<std::string> framework = form;
  framework.insert("framework/experiment");
  const auto with = [&](const std::string& own) {
    std::set<std::string> layers = framework;
    layers.insert(own);
    return layers;
  };
  std::set<std::string> everything = framework;
  everything.insert({"energies", "solvers", "integrators", "experiments"});
  const std::map<std::string, std::set<std::string>> allowed = {{"framework/base", base},
                                                                {"framework/domain", domain},
                                                                {"framework/topology", topology},
                                                                {"framework/operators", operators},
                                                                {"framework/solver", solver},
                                                                {"framework/form", form},
                                                                {"framework/experiment", framework},
                                                                {"energies", with("energies")},
                                                                {"solvers", with("solvers")},
                                                                {"integrators", with("integrators")},
                                                                {"experiments", everything}};

  int includes = 0;
  for (const fs::path& file :
       files_in({"framework", "energies", "solvers", "integrators", "experiments"}, {".h", ".cpp"})) {
    const auto rule = allowed.find(layer_of(file));
    ASSERT_NE(rule, allowed.end()) << file << " is in a layer without a rule";
    for (const std::string& included : matches(content_of(kSource / file), R"re(^\s*#\s*include\s*"([^"]+)")re")) {
      ++includes;
      EXPECT_TRUE(fs::exists(kSource / included)) << file << " includes " << included << ", which is not there";
      EXPECT_TRUE(rule->second.count(layer_of(included)) > 0) << file << " must not include " << included;
    }
  }
  EXPECT_GT(includes, 100) << "the includes were not found";
}

TEST(Structure, EveryHeaderHasALicenceLineAndAGuard) {
  const std::vector<fs::path> headers =
      files_in({"framework", "energies", "solvers", "integrators", "experiments", "tests"}, {".h"});
  EXPECT_GT(headers.size(), 40u);
  for (const fs::path& header : headers) {
    EXPECT_THAT(content_of(kSource / header), StartsWith("// SPDX-License-Identifier: BSD-3-Clause\n#pragma once\n"))
        << header;
  }
}

TEST(Structure, EverySourceHasALicenceLine) {
  const std::vector<fs::path> sources =
      files_in({"framework", "energies", "solvers", "integrators", "experiments", "tests"}, {".cpp"});
  EXPECT_GT(sources.size(), 60u);
  for (const fs::path& source : sources) {
    EXPECT_THAT(content_of(kSource / source), StartsWith("// SPDX-License-Identifier: BSD-3-Clause\n")) << source;
  }
}

TEST(Structure, EveryNonlinearBackendIsRegistered) {
  const std::set<std::string> names = defined("solvers/nonlinear", "NonlinearBackendEntry");
  EXPECT_FALSE(names.empty());
  EXPECT_EQ(names, listed("solvers/nonlinear/nonlinear_backends.cpp"));
  EXPECT_EQ(names.size(), nonlinear_backends().entries().size());
}

TEST(Structure, EveryOdeBackendIsRegistered) {
  const std::set<std::string> names = defined("integrators/ode", "OdeBackendEntry");
  EXPECT_FALSE(names.empty());
  EXPECT_EQ(names, listed("integrators/ode/ode_backends.cpp"));
  EXPECT_EQ(names.size(), ode_backends().entries().size());
}

TEST(Structure, EveryPipelineIsRegistered) {
  const std::set<std::string> names = defined("experiments", "PipelineEntry");
  EXPECT_FALSE(names.empty());
  EXPECT_EQ(names, listed("experiments/pipelines.cpp"));
  EXPECT_EQ(names.size(), pipelines().entries().size());
}

TEST(Structure, WhatIsRegisteredIsDescribedAndWorks) {
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    EXPECT_FALSE(entry.doc.empty()) << entry.name;
    if (entry.available) {
      EXPECT_NE(make_nonlinear_backend(entry.name), nullptr) << entry.name;
    }
  }
  for (const OdeBackendEntry& entry : ode_backends().entries()) {
    EXPECT_FALSE(entry.doc.empty()) << entry.name;
    if (entry.available) {
      EXPECT_NE(make_ode_backend(entry.name), nullptr) << entry.name;
    }
  }
  for (const PipelineEntry& entry : pipelines().entries()) {
    EXPECT_FALSE(entry.doc.empty()) << entry.name;
    EXPECT_TRUE(entry.run) << entry.name;
    EXPECT_TRUE(entry.check) << entry.name;
    EXPECT_FALSE(entry.sections.empty()) << entry.name;
    for (const Metric& metric : entry.metrics) EXPECT_FALSE(metric.doc.empty()) << entry.name << metric.column.key;
  }
}

TEST(Structure, EveryShippedExperimentMakesSense) {
  const std::vector<fs::path> configs = files_in({"experiments"}, {".toml"});
  EXPECT_GT(configs.size(), 10u);
  for (const fs::path& path : configs) {
    EXPECT_NO_THROW({
      const Config config = Config::load(kSource / path);
      EXPECT_GE(check_experiment(config, pipelines()), 1) << path;
      EXPECT_TRUE(config.root().has("title")) << path;
      EXPECT_TRUE(config.root().has("source")) << path;
    }) << path;
  }
}

}  // namespace
}  // namespace variform
