// SPDX-License-Identifier: BSD-3-Clause
#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <new>

#include "experiments/cli/commands.h"
#include "solvers/linear/blas.h"

namespace variform {

std::atomic<bool> interrupted{false};

namespace {

// The first signal ends what runs and writes what is finished; a second one ends this process.
void on_interrupt(int signal) {
  interrupted = true;
  std::signal(signal, SIG_DFL);
}

int main_checked(int argc, char** argv) {
  CLI::App app(
      "Solver research framework for variational geometry processing.\n"
      "Exit codes: 0 done, 1 a claim failed under reproduce, 2 bad usage or config, 3 bad input data, 4 a solver "
      "failed, or a run crashed or broke a limit, 130 interrupted.");
  app.require_subcommand(0, 1);
  bool is_version = false;
  app.add_flag("--version", is_version, "version, effective licence and BLAS");
  RunArguments arguments;
  const auto add_run_options = [&](CLI::App* command) {
    command->add_option("--set", arguments.set, "replace a value of the config: key=value, for example norm.beta=0.3")
        ->take_all();
    command
        ->add_option("--jobs", arguments.jobs,
                     "points that run at a time, each in a process of its own (default 1); 0: in this process")
        ->check(CLI::Range(0, 4096));
    command->add_option("--time-limit", arguments.limits.seconds, "seconds that a point may take")
        ->check(CLI::PositiveNumber);
    command->add_option("--memory-limit", arguments.limits.memory_mib, "MiB of memory that a point may take")
        ->check(CLI::PositiveNumber);
    command->add_flag("--resume", arguments.resume,
                      "take finished points of an earlier run in the same folder, go on with unfinished ones");
    command->add_flag("--no-figures", arguments.no_figures, "no pictures");
    command->add_flag("--quiet", arguments.quiet, "no progress and no table");
  };
  CLI::App* run_command = app.add_subcommand("run", "run a config");
  run_command->add_option("config", arguments.config, "TOML file")->required();
  run_command->add_option("--out", arguments.out, "folder for the results")->required();
  add_run_options(run_command);
  CLI::App* sweep_command = app.add_subcommand("sweep", "run a config over many values of its keys");
  sweep_command->add_option("config", arguments.config, "TOML file")->required();
  sweep_command->add_option("--out", arguments.out, "folder for the results")->required();
  sweep_command
      ->add_option("--grid", arguments.grid, "key=[values], for example norm.beta=[0,0.2,0.4]; several make a grid")
      ->take_all();
  sweep_command->add_option("--zip", arguments.zip, "key=[values]; first values of all, second values, ...")
      ->take_all();
  sweep_command
      ->add_option("--random", arguments.random, "key=[low,high], or [choices], or { min, max, scale, integer }")
      ->take_all();
  sweep_command->add_option("--lhs", arguments.latin_hypercube, "the same as a Latin hypercube")->take_all();
  sweep_command->add_option("--samples", arguments.samples, "number of points of --random and --lhs");
  sweep_command->add_option("--seed", arguments.seed, "of the sweep's random numbers");
  add_run_options(sweep_command);
  CompareArguments backends;
  CLI::App* compare_command = app.add_subcommand("compare", "solve the problems of a config by several backends");
  compare_command->add_option("config", arguments.config, "TOML file, with or without [backends]")->required();
  compare_command->add_option("--out", arguments.out, "folder for the results")->required();
  compare_command
      ->add_option("--linear", backends.linear, "linear backends, separated by commas; all: those of this build")
      ->delimiter(',');
  compare_command->add_option("--nonlinear", backends.nonlinear, "nonlinear ones; with --linear: every pair")
      ->delimiter(',');
  compare_command->add_option("--repeats", backends.repeats, "timed runs of each (default 5)");
  compare_command->add_option("--warm-up", backends.warm_up, "runs before that are not counted (default 1)");
  compare_command->add_option("--accuracy", backends.accuracy, "excess of energy up to which a problem is solved");
  compare_command->add_option("--reference", backends.reference, "variant whose solution is the reference");
  add_run_options(compare_command);
  std::vector<std::string> places;
  CLI::App* reproduce_command = app.add_subcommand("reproduce", "run experiments and check their claims");
  reproduce_command->add_option("configs", places, "TOML files or folders (default: all shipped experiments)");
  reproduce_command->add_option("--out", arguments.out, "folder for the results")->default_val("runs/reproduce");
  add_run_options(reproduce_command);
  TableArguments table_arguments;
  CLI::App* table_command = app.add_subcommand("table", "the rows of a finished run, or a pivot of them");
  table_command->add_option("folder", table_arguments.folder, "folder of the run")->required();
  table_command->add_option("--rows", table_arguments.rows, "keys of the lines, separated by commas")->delimiter(',');
  table_command->add_option("--columns", table_arguments.columns, "keys of the columns, separated by commas")
      ->delimiter(',');
  table_command->add_option("--value", table_arguments.value, "metric in the cells");
  table_command
      ->add_option("--aggregate", table_arguments.aggregate, "of several rows in a cell: mean, median, min, max, count")
      ->check(CLI::IsMember({"mean", "median", "min", "max", "count"}));
  table_command->add_option("--format", table_arguments.format, "md (default), csv, tex, json")
      ->check(CLI::IsMember({"md", "csv", "tex", "json"}));
  // What a run starts for its points; of no use by hand.
  CLI::App* point_command = app.add_subcommand("point", "run one point")->group("");
  std::string what;
  CLI::App* list_command = app.add_subcommand("list", "what there is to choose from, with parameters and defaults");
  list_command->add_option("what", what, "only this kind")
      ->check(CLI::IsMember({"energies", "backends", "generators", "norms", "pipelines", "metrics", "config"}));
  std::string mesh;
  bool triangulate = false;
  CLI::App* info_command = app.add_subcommand("info", "facts about a mesh file");
  info_command->add_option("mesh", mesh, "mesh file")->required();
  info_command->add_flag("--triangulate", triangulate, "split polygons into triangles");
  CLI::App* doctor_command = app.add_subcommand("doctor", "check this build and machine");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? static_cast<int>(ExitCode::done) : static_cast<int>(ExitCode::usage);
  }
  // Several BLAS threads would make the last digits depend on the load of the machine.
  if (std::getenv("OPENBLAS_NUM_THREADS") == nullptr) set_blas_threads(1);
  if (point_command->parsed()) return point();
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
  ExitCode code = ExitCode::done;
  if (is_version) {
    code = version();
  } else if (run_command->parsed()) {
    code = run(arguments);
  } else if (sweep_command->parsed()) {
    code = sweep(arguments);
  } else if (compare_command->parsed()) {
    code = compare(arguments, backends);
  } else if (reproduce_command->parsed()) {
    code = reproduce(places, arguments);
  } else if (table_command->parsed()) {
    code = table(table_arguments);
  } else if (list_command->parsed()) {
    code = list(what);
  } else if (info_command->parsed()) {
    code = info(mesh, triangulate);
  } else if (doctor_command->parsed()) {
    code = doctor();
  } else {
    fmt::print("{}", app.help());
    return static_cast<int>(ExitCode::usage);
  }
  return interrupted ? 128 + SIGINT : static_cast<int>(code);
}

}  // namespace
}  // namespace variform

int main(int argc, char** argv) {
  try {
    return variform::main_checked(argc, argv);
  } catch (const variform::Error& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return static_cast<int>(error.exit_code());
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "error: out of memory\n");
    return static_cast<int>(variform::ExitCode::solver);
  } catch (const std::exception& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return static_cast<int>(variform::ExitCode::data);
  }
}
