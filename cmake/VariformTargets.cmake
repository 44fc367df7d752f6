# SPDX-License-Identifier: BSD-3-Clause
# Flags that every target of this project shares, and helpers to declare targets.

add_library(variform_flags INTERFACE)
target_compile_options(variform_flags INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor)
# GCC 12 sees out-of-bounds accesses in std::sort and std::string that are not there, and its sanitized build with
# uninitialized values inside Eigen and the standard library.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(variform_flags INTERFACE -Wno-array-bounds -Wno-stringop-overflow -Wno-restrict)
  if(VARIFORM_SANITIZE)
    target_compile_options(variform_flags INTERFACE -Wno-maybe-uninitialized)
  endif()
endif()
if(VARIFORM_WARNINGS_AS_ERRORS)
  target_compile_options(variform_flags INTERFACE -Werror)
endif()
if(VARIFORM_SANITIZE)
  target_compile_options(variform_flags INTERFACE -fsanitize=address,undefined -fno-sanitize-recover=undefined
                                                  -fno-omit-frame-pointer)
  target_link_options(variform_flags INTERFACE -fsanitize=address,undefined)
endif()

# variform_library(NAME [SOURCES ...] PUBLIC ... PRIVATE ...): static library variform_NAME, alias variform::NAME, of the
# sources given, or every .cpp in and below the current folder.
function(variform_library NAME)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  if(NOT ARG_SOURCES)
    file(GLOB_RECURSE ARG_SOURCES CONFIGURE_DEPENDS *.cpp)
  endif()
  add_library(variform_${NAME} STATIC ${ARG_SOURCES})
  add_library(variform::${NAME} ALIAS variform_${NAME})
  set_target_properties(variform_${NAME} PROPERTIES EXPORT_NAME ${NAME})
  target_include_directories(variform_${NAME} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
                                                     $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/variform>)
  target_compile_features(variform_${NAME} PUBLIC cxx_std_20)
  target_link_libraries(variform_${NAME} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE} $<BUILD_INTERFACE:variform_flags>)
  set_property(GLOBAL APPEND PROPERTY VARIFORM_LIBRARIES variform_${NAME})
endfunction()

# variform_test(NAME [FOLDER ...] LIBRARIES ...): one GoogleTest executable of every .cpp in the folder (NAME, if none is
# given), its cases discovered by CTest.
function(variform_test NAME)
  cmake_parse_arguments(ARG "" "FOLDER" "LIBRARIES" ${ARGN})
  if(NOT ARG_FOLDER)
    set(ARG_FOLDER ${NAME})
  endif()
  file(GLOB ARG_SOURCES CONFIGURE_DEPENDS ${ARG_FOLDER}/*.cpp)
  add_executable(test_${NAME} ${ARG_SOURCES})
  target_link_libraries(test_${NAME} PRIVATE ${ARG_LIBRARIES} variform_flags GTest::gmock GTest::gtest_main)
  target_compile_definitions(test_${NAME} PRIVATE VARIFORM_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  gtest_discover_tests(test_${NAME} DISCOVERY_TIMEOUT 120 PROPERTIES TIMEOUT 600)
endfunction()
