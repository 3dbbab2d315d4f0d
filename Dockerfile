# The command line in an image: docker build -t tinygc . && docker run --rm -v "$PWD":/work tinygc demo
# By its digest: Python 3.11.15 on Debian 12; all that pip installs comes from one index.
FROM python:3.11-slim-bookworm@sha256:d29f48a31a8b408ed19272ca1e7b10ebae13b240a27e862d3d4217c528e2e0c3 AS wheel
WORKDIR /source
COPY pyproject.toml README.md LICENSE MANIFEST.in calibrate.py ./
COPY session session
COPY tinygc tinygc
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.11-slim-bookworm@sha256:d29f48a31a8b408ed19272ca1e7b10ebae13b240a27e862d3d4217c528e2e0c3
COPY constraints.txt /tmp/constraints.txt
COPY --from=wheel /wheel /tmp/wheel
RUN python -m pip install --no-cache-dir -c /tmp/constraints.txt /tmp/wheel/*.whl \
    && useradd --uid 1000 --create-home calibrate \
    && mkdir /work && chown calibrate /work
USER calibrate
WORKDIR /work
ENTRYPOINT ["calibrate"]
CMD ["--help"]
