# shellcheck shell=bash
# What the checks need that Rust does not bring: found, or installed. Sourced by the scripts of this folder.

# Sees to it that command $@ runs, which belongs to Rust.
need() {
    if ! "$@" >/dev/null 2>&1; then
        echo "error: '$*' does not run" >&2
        echo "  help: install Rust with rustup, then: rustup component add rustfmt clippy" >&2
        exit 1
    fi
}

# Installs Debian's packages $2 …; without them $1 cannot run. One script at a time.
install() {
    local what=$1
    shift
    if [[ $(id -u) != 0 ]] || ! command -v apt-get >/dev/null; then
        echo "error: $what cannot run without: $*" >&2
        echo "  help: install them, on Debian: apt-get install $*" >&2
        exit 1
    fi
    flock .ci/tools.sh apt-get update -q
    DEBIAN_FRONTEND=noninteractive flock .ci/tools.sh apt-get install -qy --no-install-recommends "$@"
}

# Sees to it that program $2, of Debian's packages $3 …, is there; without it $1 cannot run.
provide() {
    local what=$1 program=$2
    shift 2
    command -v "$program" >/dev/null || install "$what" "$@"
}

# Sees to it that there is a Vulkan driver.
provide_vulkan() {
    compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null \
        || install "the tests of GPU backends" mesa-vulkan-drivers libvulkan1
}

# Runs program $1 of version $2 with the arguments $4 …; PyPI's project $3 has it ready-made. It is kept in target/tools.
tool() {
    local program=$1 version=$2 project=$3
    local folder=target/tools/$program-$version
    shift 3
    if [[ ! -x $folder/bin/$program ]]; then
        python3 -m pip --version >/dev/null 2>&1 || install "$program" python3 python3-pip
        # Into a new folder, which needs no virtual environment; renamed at the end, so that no half of it is taken for the whole.
        rm -rf "$folder" "$folder.part"
        if ! python3 -m pip install -q --disable-pip-version-check --root-user-action=ignore --no-deps --only-binary :all: \
            --target "$folder.part" "$project==$version"; then
            echo "error: no $program $version for this machine on PyPI" >&2
            echo "  help: put it into $folder/bin yourself, with 'cargo install --locked --root $folder' and its crate" >&2
            return 1
        fi
        mv "$folder.part" "$folder"
    fi
    "$folder/bin/$program" "$@"
}
