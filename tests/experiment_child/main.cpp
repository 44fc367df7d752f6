// SPDX-License-Identifier: BSD-3-Clause
// A program to be run by tests as a child process: does what its arguments say.
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <new>
#include <string>
#include <thread>
#include <vector>

namespace {

void rest(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

// Takes memory until it is stopped, 8 MiB at a time, and touches it.
void hog(int mib) {
  constexpr std::size_t kBlock = std::size_t{8} << 20;
  std::vector<char*> blocks;
  for (int taken = 0; taken < mib; taken += 8) {
    blocks.push_back(static_cast<char*>(std::malloc(kBlock)));
    if (blocks.back() == nullptr) throw std::bad_alloc();
    std::memset(blocks.back(), taken % 7 + 1, kBlock);
    rest(0.002);
  }
  for (char* block : blocks) std::free(block);
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
    hog(static_cast<int>(number()));
  } else if (what == "bad_alloc") {
    return 12;
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
