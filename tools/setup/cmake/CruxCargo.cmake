# crux_cargo_staticlib(<target> MANIFEST_DIR <folder> INCLUDE_DIR <folder> [LIBRARY <name>])
#
# Builds the Rust crate in MANIFEST_DIR as a static library and gives it as the imported target <target>, with
# INCLUDE_DIR as its header folder. LIBRARY is the crate's library name, <target> unless told.
#
# The crate commits `Cargo.lock.in`, a lock in which the place of every package reads `source = "@CRATES_IO@"`; the
# build folder gets a copy with cargo's own name for the public crate index. After changing a dependency, run the target
# <target>_lock: it resolves anew and writes Cargo.lock.in back.
set(CRUX_CRATES_IO "registry+https://github.com/rust-lang/crates.io-index")

function(crux_cargo_staticlib target)
  cmake_parse_arguments(ARG "" "MANIFEST_DIR;INCLUDE_DIR;LIBRARY" "" ${ARGN})
  if(NOT ARG_LIBRARY)
    set(ARG_LIBRARY ${target})
  endif()
  set(cargo ${CMAKE_SOURCE_DIR}/tools/setup/cargo)

  cmake_path(SET work NORMALIZE ${CMAKE_BINARY_DIR}/../cargo/${target}) # one for all build folders beside each other
  set(library ${work}/target/release/lib${ARG_LIBRARY}.a)
  set(CRATES_IO ${CRUX_CRATES_IO})
  file(MAKE_DIRECTORY ${work})
  configure_file(${ARG_MANIFEST_DIR}/Cargo.toml ${work}/Cargo.toml COPYONLY)
  configure_file(${ARG_MANIFEST_DIR}/Cargo.lock.in ${work}/Cargo.lock @ONLY)
  file(CREATE_LINK ${ARG_MANIFEST_DIR}/src ${work}/src SYMBOLIC)

  # Where the crates lay says nothing to a user. For another architecture the standard library is that of its packages.
  string(ASCII 31 next) # what cargo parts flags by, since paths have spaces
  set(flags "--remap-path-prefix=$ENV{HOME}/.cargo/registry/src=crates${next}--remap-path-prefix=${work}=${target}")
  set(built ${work}/target)
  if(CMAKE_CROSSCOMPILING)
    set(cargo ${CRUX_CARGO})
    set(triple ${CMAKE_SYSTEM_PROCESSOR}-unknown-linux-gnu)
    string(APPEND flags "${next}-L${next}${CMAKE_SYSROOT}/usr/lib/rustlib/${triple}/lib")
    set(environment RUSTC=${CRUX_RUSTC})
    set(choice --target ${triple})
    set(library ${built}/${triple}/release/lib${ARG_LIBRARY}.a)
  endif()

  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${ARG_MANIFEST_DIR}/src/*.rs)
  add_custom_command(
    OUTPUT ${library}
    COMMAND ${CMAKE_COMMAND} -E env "CARGO_ENCODED_RUSTFLAGS=${flags}" ${environment}
            ${cargo} build --release --locked --quiet --jobs 2 ${choice}
            --manifest-path ${work}/Cargo.toml --target-dir ${built}
    COMMAND ${CMAKE_COMMAND} -E touch ${library}
    DEPENDS ${sources} ${work}/Cargo.toml ${work}/Cargo.lock
    COMMENT "cargo build ${target}" VERBATIM)
  add_custom_target(${target}_build DEPENDS ${library})
  add_custom_target(${target}_lock
    COMMAND ${cargo} generate-lockfile --manifest-path ${work}/Cargo.toml
    COMMAND sed "s|^source = \"registry+.*\"|source = \"@CRATES_IO@\"|" ${work}/Cargo.lock > ${ARG_MANIFEST_DIR}/Cargo.lock.in
    COMMENT "resolve ${target} and write Cargo.lock.in" VERBATIM)

  add_library(${target} STATIC IMPORTED GLOBAL)
  set_target_properties(${target} PROPERTIES
    IMPORTED_LOCATION ${library}
    INTERFACE_INCLUDE_DIRECTORIES ${ARG_INCLUDE_DIR}
    INTERFACE_LINK_LIBRARIES "pthread;dl;m")
  add_dependencies(${target} ${target}_build)
endfunction()
