// SPDX-License-Identifier: BSD-3-Clause
// A program to be run by tests as a child process: does what its arguments say.
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "framework/base/error.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/process_pool.h"
#include "framework/experiment/runner.h"
#include "tests/experiment_child/trouble.h"

namespace {

void rest(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

int point() {
  try {
    variform::run_point_request({std::istreambuf_iterator<char>(std::cin), {}}, variform::trouble_pipelines());
  } catch (const variform::Error& error) {
    std::cerr << "error: " << error.what() << "\n";
    return static_cast<int>(error.exit_code());
  } catch (const std::bad_alloc&) {
    return variform::kExitOutOfMemory;
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << "\n";
    return static_cast<int>(variform::ExitCode::data);
  }
  return 0;
}

int act(const std::vector<std::string>& words) {
  const std::string what = words.empty() ? "" : words[0];
  const auto number = [&words] { return words.size() > 1 ? std::stod(words[1]) : 0.0; };
  if (what == "echo") {
    std::cout << std::string(std::istreambuf_iterator<char>(std::cin), {});
  } else if (what == "exit") {
    std::cerr << "some noise\nerror: exit " << words[1] << " as asked\nmore noise\n";
    return std::stoi(words[1]);
  } else if (what == "abort") {
    std::signal(SIGABRT, SIG_DFL);
    std::abort();
  } else if (what == "rest") {
    rest(number());
  } else if (what == "ignore") {  // SIGTERM
    std::signal(SIGTERM, SIG_IGN);
    rest(number());
  } else if (what == "work") {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(number());
    while (std::chrono::steady_clock::now() < end) {
    }
  } else if (what == "meet") {  // makes a file and waits for another
    std::ofstream(words[1]) << "here";
    while (!std::filesystem::exists(words[2])) rest(0.001);
  } else if (what == "hog") {
    variform::take_memory(static_cast<int>(number()), words.size() > 2 ? std::stod(words[2]) : 0.0);
  } else if (what == "bad_alloc") {
    return variform::kExitOutOfMemory;
  } else if (what == "pool") {  // runs this program as its child, which says its id into a file
    variform::run_processes({{{variform::kThisProgram, "sign", words[1]}}}, {});
  } else if (what == "sign") {
    variform::write_file(words[1], std::to_string(getpid()));
    rest(3600.0);
  } else if (what == "keep") {  // saves states of one letter each, again and again
    const variform::Workspace workspace(words[1], "key", false);
    for (char letter = 'a';; letter = letter == 'z' ? 'a' : static_cast<char>(letter + 1)) {
      workspace.save(std::string(std::size_t{1} << 20, letter));
    }
  } else if (what == "study") {  // runs a config in processes, into a folder
    const auto config = variform::Config::parse(words[1], "study.toml", std::filesystem::temp_directory_path());
    variform::run_experiment(
        config, variform::trouble_pipelines(),
        {.folder = words[2], .figures = false, .point_command = {variform::kThisProgram, "point"}});
  } else if (what == "point") {
    return point();
  } else if (what == "parent") {  // says its child's id and rests
    const pid_t child = fork();
    if (child == 0) {
      rest(number());
      _exit(0);
    }
    std::cout << child << std::endl;
    rest(number());
  } else {
    std::cerr << "error: unknown word '" << what << "'\n";
    return 2;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) { return act({argv + 1, argv + argc}); }
