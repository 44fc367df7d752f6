# SPDX-License-Identifier: BSD-3-Clause
# Installs BUILD into a folder of its own, builds the project CONSUMER against it and runs what comes out.
#   cmake -DSOURCE=... -DBUILD=... -DCONSUMER=... -DGENERATOR=... -DCXX=... -DBUILD_TYPE=... -P check_install.cmake
set(work ${BUILD}/install-test)
set(prefix ${work}/prefix)
file(REMOVE_RECURSE ${work})

function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE code OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT code EQUAL 0)
    string(JOIN " " command ${ARGV})
    message(FATAL_ERROR "${command} answers ${code}:\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

run(${CMAKE_COMMAND} --install ${BUILD} --config ${BUILD_TYPE} --prefix ${prefix})

file(GLOB_RECURSE exported ${prefix}/lib*/cmake/variform/*.cmake)
list(LENGTH exported count)
if(count LESS 4)
  message(FATAL_ERROR "expected config, version and targets files, found: ${exported}")
endif()
foreach(file IN LISTS exported)
  file(READ ${file} content)
  foreach(path ${SOURCE} ${BUILD})
    string(FIND "${content}" "${path}" place)
    if(NOT place EQUAL -1)
      message(FATAL_ERROR "${file} names ${path}, which is not there where the library is used")
    endif()
  endforeach()
endforeach()

run(${CMAKE_COMMAND} -S ${CONSUMER} -B ${work}/build -G ${GENERATOR} -DCMAKE_CXX_COMPILER=${CXX}
    -DCMAKE_BUILD_TYPE=${BUILD_TYPE} -DCMAKE_PREFIX_PATH=${prefix})
run(${CMAKE_COMMAND} --build ${work}/build --config ${BUILD_TYPE})
find_program(CONSUMER_PROGRAM consumer PATHS ${work}/build ${work}/build/${BUILD_TYPE} NO_DEFAULT_PATH REQUIRED)
run(${CONSUMER_PROGRAM})
message(STATUS "${output}")

# The installed program finds the installed experiments; an unknown pipeline keeps them from running.
execute_process(COMMAND ${prefix}/bin/variform reproduce --quiet --out ${work}/runs --set pipeline=none
                RESULT_VARIABLE code OUTPUT_VARIABLE output ERROR_VARIABLE errors)
if(NOT code EQUAL 2 OR NOT errors MATCHES "${prefix}/share/variform/experiments/smoothed_energies/demo.toml")
  message(FATAL_ERROR "the installed variform does not find its experiments (answers ${code}):\n${errors}")
endif()
file(REMOVE_RECURSE ${work})
