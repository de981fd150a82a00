# The simulated rig without a window, as `make run ARGS=--headless` runs it on Debian 12:
#   docker build -t tams .
#   docker run --rm --init --shm-size=256m --cap-add=SYS_NICE -v "$PWD/logs:/tams/logs" tams
FROM debian:12
RUN apt-get update --quiet=2 && apt-get install --yes --quiet=2 --no-install-recommends \
    ca-certificates make
WORKDIR /tams
# What is installed changes rarely: what these files name stays as it is when only code has changed.
COPY Makefile setup.sh apt-packages.txt requirements.lock requirements-build.lock \
    requirements-girepository-2.lock ./
RUN make setup
COPY . .
CMD ["make", "run", "ARGS=--headless"]
