# The command line in an image: docker build -t tinygc . && docker run --rm -v "$PWD":/work tinygc demo
FROM python:3.11-slim AS wheel
WORKDIR /source
COPY pyproject.toml README.md LICENSE MANIFEST.in calibrate.py ./
COPY session session
COPY tinygc tinygc
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.11-slim
COPY constraints.txt /tmp/constraints.txt
COPY --from=wheel /wheel /tmp/wheel
RUN python -m pip install --no-cache-dir -c /tmp/constraints.txt /tmp/wheel/*.whl \
    && useradd --uid 1000 --create-home calibrate \
    && mkdir /work && chown calibrate /work
USER calibrate
WORKDIR /work
ENTRYPOINT ["calibrate"]
CMD ["--help"]
