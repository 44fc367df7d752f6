# SPDX-License-Identifier: BSD-3-Clause
# find_package(variform) for others: libraries, headers under include/variform, shipped experiments, CLI.
include(CMakePackageConfigHelpers)
get_property(libraries GLOBAL PROPERTY VARIFORM_LIBRARIES)
install(TARGETS ${libraries} EXPORT variformTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
foreach(target variform_suitesparse variform_ceres variform_nlopt variform_petsc variform_slepc variform_arpack variform_sundials)
  if(TARGET ${target})
    install(TARGETS ${target} EXPORT variformTargets)
  endif()
endforeach()
install(TARGETS variform_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
# Headers include each other as "framework/...", so this folder is the include directory of all targets.
foreach(folder framework energies solvers integrators experiments)
  install(DIRECTORY ${folder} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/variform FILES_MATCHING PATTERN "*.h"
          PATTERN "benchmarks" EXCLUDE)
endforeach()
install(DIRECTORY experiments/smoothed_energies experiments/solvers DESTINATION ${CMAKE_INSTALL_DATADIR}/variform/experiments
        FILES_MATCHING PATTERN "*.toml")
install(EXPORT variformTargets NAMESPACE variform:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/variform)
configure_package_config_file(cmake/variformConfig.cmake.in ${PROJECT_BINARY_DIR}/variformConfig.cmake
                              INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/variform)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/variformConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/variformConfig.cmake ${PROJECT_BINARY_DIR}/variformConfigVersion.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/variform)
